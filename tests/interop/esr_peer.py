#!/usr/bin/env python3
"""A subscriber that computes the error of the node's force independently, for comparison with `mr-damper evaluate`.

Receives force_residual and force_estimate as raw bytes, so that Python keeps up with runs of several kilohertz, and decodes them at
the end. NMSE is the sum of squared errors divided by the sum of squares of measured force about its mean. Two results:
  residual    measured minus predicted, from force_residual: the model in simulation (free run)
  estimate    force_estimate in the modes of --modes, compared with the measured force of the same stamp

Prints {"event": "ready"} when the node's topics are discovered, then one JSON line with the results.
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
    parser.add_argument("--expect", type=int, default=0, help="number of residuals to wait for; 0: until no more arrive")
    parser.add_argument("--idle", type=float, default=3.0, help="seconds without a message that end the run")
    parser.add_argument("--seconds", type=float, default=300.0, help="longest wait for the end of the run")
    parser.add_argument("--modes", default="arx", help="modes of force_estimate to score, comma-separated")
    parser.add_argument("--dump", help="file for every residual: stamp in ns, measured, predicted")
    return parser.parse_args()


def score(pairs):
    """Number of samples, NMSE and RMSE (N) of (measured, predicted) pairs."""
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
    # The node's writers are discovered; now the node needs time to discover our readers.
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    emit({"event": "ready"})
    started = last = time.monotonic()
    seen = 0
    while True:
        executor.spin_once(timeout_sec=0.1)
        # Estimates continue after the run: the node holds its last estimate, and then reports that
        # it has none.
        count = len(raw["force_residual"])
        now = time.monotonic()
        if count != seen:
            seen, last = count, now
        if args.expect and count >= args.expect and now - last > 0.5:
            break
        if count and now - last > args.idle:
            break
        if now - started > args.seconds:
            fail(f"only {count} residuals arrived within {args.seconds:g} s")
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
