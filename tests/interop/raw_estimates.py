#!/usr/bin/env python3
"""Receives force estimates with rclpy as they come from the wire, without decoding them.

usage: raw_estimates.py TOPIC FILE

Writes each payload (CDR) to FILE, a line of hexadecimal digits. Ends when its standard input closes, and prints one line of JSON with the
number of estimates. Run it through ros-python.sh.
"""

import sys
import threading

import rclpy
from mr_damper_msgs.msg import ForceEstimate
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import emit
from ros_common import qos


def main():
    topic, file = sys.argv[1:]
    rclpy.init()
    node = Node("raw_estimates")
    payloads = []
    node.create_subscription(ForceEstimate, topic, lambda raw: payloads.append(bytes(raw)), qos(1000), raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    emit({"event": "ready"})
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.05)
    with open(file, "w", encoding="ascii") as out:
        out.writelines(payload.hex() + "\n" for payload in payloads)
    emit({"estimates": len(payloads)})
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
