#!/usr/bin/env python3
"""Round trip of one damper's samples: from displacement to the force_estimate with the same stamp.

Publishes coil_current, measured_force and displacement at a fixed rate from one thread, which also receives the answers, so the times
include the cost of rclpy itself. They serve to compare different programs at the other end: the node, or the bare echo. Prints one
JSON line; times are in microseconds.
"""

import argparse
import statistics
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import Pace, emit, fail, percentile, samples
from ros_common import TYPES, message, qos, to_ns, wait_until


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=1000.0, help="samples per second")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--warm-up", type=float, default=1.0, help="seconds at the start that are not counted")
    parser.add_argument("--drain", type=float, default=2.0, help="longest wait for the last answers, seconds")
    return parser.parse_args()


class RoundTrip:
    def __init__(self):
        self.node = Node("round_trip")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.publishers = {
            topic: self.node.create_publisher(TYPES[topic], topic, qos(100))
            for topic in ("coil_current", "measured_force", "displacement")
        }
        self.node.create_subscription(TYPES["force_estimate"], "force_estimate", self.on_estimate, qos(1000))
        self.sent = {}
        self.times = []
        self.repeated = 0
        self.seen = set()
        self.answers = 0

    def on_estimate(self, estimate):
        now = time.perf_counter_ns()
        self.answers += 1
        ns = to_ns(estimate.header.stamp)
        began = self.sent.pop(ns, None)
        if began is not None:
            self.times.append((now - began) / 1e3)
            self.seen.add(ns)
        elif ns in self.seen:
            self.repeated += 1

    def connect(self):
        displacement = self.publishers["displacement"]
        wait_until(
            lambda: displacement.get_subscription_count() > 0
            and self.node.count_publishers("force_estimate") > 0,
            self.executor,
            15.0,
            "no program subscribes to displacement and publishes force_estimate",
        )
        for _ in range(200):
            displacement.publish(message("displacement", time.time_ns(), 0.0))
            self.executor.spin_once(timeout_sec=0.05)
            if self.answers:
                return
        fail("no force_estimate came back for 200 displacements in 10 s")

    def send(self, rate, seconds, counted):
        pace = Pace(rate)
        count = 0
        for displacement, current, force in samples(None, rate, seconds):
            # Receives answers while there is time. In the last 0.2 ms it spins without waiting, because a
            # timed wait oversleeps.
            while (remaining := pace.remaining()) > 0:
                self.executor.spin_once(timeout_sec=max(0.0, remaining - 0.0002))
            ns = pace.stamp_ns()
            self.publishers["coil_current"].publish(message("coil_current", ns, current))
            self.publishers["measured_force"].publish(message("measured_force", ns, force))
            ready = message("displacement", ns, displacement)
            if counted:
                self.sent[ns] = time.perf_counter_ns()
                count += 1
            self.publishers["displacement"].publish(ready)
            pace.advance()
        return count, pace.latest

    def drain(self, seconds):
        end = time.monotonic() + seconds
        while self.sent and (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)


def main():
    args = arguments()
    rclpy.init()
    trip = RoundTrip()
    trip.connect()
    trip.send(args.rate, args.warm_up, counted=False)
    began = time.perf_counter()
    sent, latest = trip.send(args.rate, args.seconds, counted=True)
    took = time.perf_counter() - began
    trip.drain(args.drain)
    emit(
        {
            "rate_hz": args.rate,
            "seconds": args.seconds,
            "achieved_hz": sent / took,
            "sent": sent,
            "received": len(trip.times),
            "lost": len(trip.sent),
            "repeated": trip.repeated,
            "p50_us": percentile(trip.times, 0.50),
            "p90_us": percentile(trip.times, 0.90),
            "p99_us": percentile(trip.times, 0.99),
            "max_us": max(trip.times, default=float("nan")),
            "mean_us": statistics.fmean(trip.times) if trip.times else float("nan"),
            "latest_send_us": latest * 1e6,
        }
    )
    trip.executor.shutdown()
    trip.node.destroy_node()
    rclpy.shutdown()


main()
