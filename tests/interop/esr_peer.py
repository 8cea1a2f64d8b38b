#!/usr/bin/env python3
"""A subscriber that works out by itself how good the node's force is, to be held against `mr-damper evaluate`.

Takes force_residual and force_estimate as raw bytes, so that Python keeps up with runs of some
kilohertz, and reads them at the end. ESR is the sum of squared errors over the sum of squares of measured force
about its mean. Two figures come out:
  residual    measured minus predicted, as force_residual carries them: the free-run model
  estimate    force_estimate in the modes asked for (--modes), against the measured force of the same stamp

Prints {"event": "ready"} when the node's topics are there, then one JSON line with the figures.
"""

import argparse
import math
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from peer_common import MODES, emit, fail
from ros_common import TYPES, qos, to_ns, wait_until

TOPICS = ("force_residual", "force_estimate")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--expect", type=int, default=0, help="residuals to wait for; 0: until nothing comes")
    parser.add_argument("--idle", type=float, default=3.0, help="seconds without a message that end the run")
    parser.add_argument("--seconds", type=float, default=300.0, help="longest wait for the end of the run")
    parser.add_argument("--modes", default="arx", help="modes of force_estimate to score, comma-separated")
    parser.add_argument("--dump", help="file for every residual: stamp in ns, measured, predicted")
    return parser.parse_args()


def score(pairs):
    """Samples, ESR and RSSE (a root mean square, in newtons) of (measured, predicted) pairs."""
    pairs = [(m, p) for m, p in pairs if math.isfinite(m) and math.isfinite(p)]
    if not pairs:
        return {"samples": 0, "esr": math.nan, "rsse_n": math.nan}
    mean = math.fsum(m for m, _ in pairs) / len(pairs)
    errors = math.fsum((m - p) ** 2 for m, p in pairs)
    spread = math.fsum((m - mean) ** 2 for m, _ in pairs)
    return {
        "samples": len(pairs),
        "esr": errors / spread if spread > 0 else math.inf,
        "rsse_n": math.sqrt(errors / len(pairs)),
    }


def collect(args):
    node = Node("esr_peer")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    raw = {topic: [] for topic in TOPICS}
    for topic in TOPICS:
        node.create_subscription(TYPES[topic], topic, raw[topic].append, qos(200_000), raw=True)
    wait_until(
        lambda: all(node.count_publishers(topic) > 0 for topic in TOPICS),
        executor,
        15.0,
        "force_residual and force_estimate have no publisher",
    )
    # We know of the node's writers now; give it the time to know of our readers.
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    emit({"event": "ready"})
    started = last = time.monotonic()
    seen = 0
    while True:
        executor.spin_once(timeout_sec=0.1)
        # Estimates go on after the run: the node says that it holds, and then that it has none.
        count = len(raw["force_residual"])
        now = time.monotonic()
        if count != seen:
            seen, last = count, now
        if args.expect and count >= args.expect and now - last > 0.5:
            break
        if count and now - last > args.idle:
            break
        if now - started > args.seconds:
            fail(f"after {args.seconds:g} s only {count} residuals came")
    executor.shutdown()
    node.destroy_node()
    return {t: [deserialize_message(bytes(b), TYPES[t]) for b in raw[t]] for t in TOPICS}


def main():
    args = arguments()
    wanted = [MODES.index(name) for name in args.modes.split(",")]
    rclpy.init()
    messages = collect(args)
    residuals = messages["force_residual"]
    estimates = messages["force_estimate"]
    measured = {to_ns(r.header.stamp): r.measured for r in residuals}
    if args.dump:
        with open(args.dump, "w", encoding="utf-8") as file:
            file.write("stamp_ns,measured_n,predicted_n\n")
            for r in residuals:
                file.write(f"{to_ns(r.header.stamp)},{r.measured!r},{r.predicted!r}\n")
    emit(
        {
            "peer": "rclpy",
            "received": {topic: len(messages[topic]) for topic in TOPICS},
            "residual": score([(r.measured, r.predicted) for r in residuals]),
            "estimate": score(
                [
                    (measured[stamp], e.force)
                    for e in estimates
                    if e.mode in wanted and (stamp := to_ns(e.header.stamp)) in measured
                ]
            ),
            "modes": {name: sum(e.mode == k for e in estimates) for k, name in enumerate(MODES)},
            "validities": {str(v): sum(e.validity == v for e in estimates) for v in range(5)},
            "models": sorted({e.model for e in estimates}),
        }
    )
    rclpy.shutdown()


main()
