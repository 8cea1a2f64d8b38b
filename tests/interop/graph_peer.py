#!/usr/bin/env python3
"""Watches one node in the graph: tells when it is there, and when it has gone.

Prints {"event": "ready"} once the node is seen, then {"event": "gone", "unix_ns": ...} when the graph no longer
lists it. Times are CLOCK_REALTIME, to compare with the moment at which the caller sent a signal.
"""

import argparse
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import emit, fail
from ros_common import full_names, wait_until


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--node", default="/mr_damper", help="fully qualified name of the node")
    parser.add_argument("--seconds", type=float, default=60.0, help="longest wait for it to go")
    args = parser.parse_args()
    rclpy.init()
    watcher = Node("graph_peer")
    executor = SingleThreadedExecutor()
    executor.add_node(watcher)
    wait_until(
        lambda: args.node in full_names(watcher),
        executor,
        15.0,
        f"{args.node} is not in the graph (seen: {full_names(watcher)})",
    )
    emit({"event": "ready"})
    deadline = time.monotonic() + args.seconds
    while args.node in full_names(watcher):
        if time.monotonic() > deadline:
            fail(f"{args.node} is still in the graph after {args.seconds:g} s")
        time.sleep(0.005)
    emit({"event": "gone", "unix_ns": time.time_ns()})
    executor.shutdown()
    watcher.destroy_node()
    rclpy.shutdown()


main()
