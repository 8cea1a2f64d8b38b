#!/usr/bin/env python3
"""An rclpy peer that sends the node's inputs at 100 Hz, or receives its estimates (--hear); a test may stop it in between.

Prints {"event": "ready"} once the node is discovered; ends when standard input closes. Run it through ros-python.sh.
"""

import argparse
import math
import sys
import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import emit
from ros_common import TYPES, message, qos, wait_until

PERIOD = 0.01
INPUTS = ("coil_current", "measured_force", "displacement")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hear", action="store_true", help="receive estimates, and send nothing")
    args = parser.parse_args()
    rclpy.init()
    node = Node("steady_peer")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    heard = []
    publishers = {}
    if args.hear:
        node.create_subscription(TYPES["force_estimate"], "force_estimate", heard.append, qos(1000))
        wait_until(lambda: node.count_publishers("/force_estimate") > 0, executor, 20.0, "no node publishes")
    else:
        publishers = {topic: node.create_publisher(TYPES[topic], topic, qos(10)) for topic in INPUTS}
        there = lambda: all(p.get_subscription_count() > 0 for p in publishers.values())  # noqa: E731
        wait_until(there, executor, 20.0, "no node listens")
    time.sleep(0.3)
    emit({"event": "ready"})
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.is_set():
        if args.hear:
            executor.spin_once(timeout_sec=0.05)
            continue
        ns = time.time_ns()
        t = ns * 1e-9 % 1000.0
        velocity = 0.008 * 4 * math.pi * math.cos(4 * math.pi * t)
        values = {
            "coil_current": 0.4,
            "measured_force": 460.0 * math.tanh(20.0 * velocity),
            "displacement": 0.008 * math.sin(4 * math.pi * t),
        }
        for topic, publisher in publishers.items():
            publisher.publish(message(topic, ns, values[topic]))
        time.sleep(PERIOD)
    emit({"heard": len(heard)})
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


ended = threading.Event()
main()
