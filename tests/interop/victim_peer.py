#!/usr/bin/env python3
"""An rclpy subscriber with default QoS to estimates and commands of several dampers, which a test kills, stops or unplugs.

With --wait or --work it is slow: it sleeps on each message, as for a disk, or computes. Prints {"event": "ready"} once it has received
messages of all dampers; ends when standard input closes. Run it through ros-python.sh.
"""

import argparse
import sys
import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import emit
from ros_common import TYPES, wait_until


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dampers", type=int, default=1)
    parser.add_argument("--wait", type=float, default=0.0, metavar="S", help="sleep on each message")
    parser.add_argument("--work", type=float, default=0.0, metavar="S", help="compute on each message")
    args = parser.parse_args()
    rclpy.init()
    node = Node("victim_peer")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    heard = set()
    ready = threading.Event()

    def hear(topic):
        def callback(_message):
            heard.add(topic)
            if ready.is_set():
                time.sleep(args.wait)
                end = time.monotonic() + args.work
                while time.monotonic() < end:
                    pass

        return callback

    topics = [f"/d{k}/{name}" for k in range(args.dampers) for name in ("force_estimate", "current_command")]
    for topic in topics:
        node.create_subscription(TYPES[topic.rsplit("/", 1)[1]], topic, hear(topic), 10)
    wait_until(lambda: len(heard) == len(topics), executor, 20.0, "not every topic was heard")
    ready.set()
    emit({"event": "ready"})
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


main()
