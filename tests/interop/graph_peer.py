#!/usr/bin/env python3
"""Watches one node in the graph: reports when it appears and when it disappears.

Prints {"event": "ready"} once the node is seen, then {"event": "gone", "unix_ns": ...} when the graph no longer lists it. Times are
CLOCK_REALTIME, for comparison with the moment at which the caller sent a signal. With --absent S it watches for S seconds, and prints
only whether the node was seen: {"found": false}.
"""

import argparse
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import emit, fail
from ros_common import full_names, wait_until


def look(args, watcher):
    """Prints whether the node appears in the graph within the next seconds."""
    deadline, found = time.monotonic() + args.absent, False
    while time.monotonic() < deadline and not found:
        found = args.node in full_names(watcher)
        time.sleep(0.05)
    emit({"found": found})
    watcher.destroy_node()
    rclpy.shutdown()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--node", default="/mr_damper", help="fully qualified name of the node")
    parser.add_argument("--seconds", type=float, default=60.0, help="longest wait for it to disappear")
    parser.add_argument("--absent", type=float, help="only check whether it appears within this many seconds")
    args = parser.parse_args()
    rclpy.init()
    watcher = Node("graph_peer")
    executor = SingleThreadedExecutor()
    executor.add_node(watcher)
    if args.absent is not None:
        look(args, watcher)
        return
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
