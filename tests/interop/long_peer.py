#!/usr/bin/env python3
"""An rclpy client that requests models with names of a megabyte, one after another, until it is killed in the middle of one.

Prints one JSON line when it starts to send. Run it through ros-python.sh.
"""

import time

import rclpy
from mr_damper_msgs.srv import LoadModel
from rclpy.node import Node

from peer_common import emit, fail

MEGABYTES = 1


def main():
    rclpy.init()
    node = Node("long_peer")
    client = node.create_client(LoadModel, "load_model")
    if not client.wait_for_service(20.0):
        fail("no node offers load_model; is the node running in this ROS_DOMAIN_ID?")
    emit({"event": "sending"})
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        client.call_async(LoadModel.Request(model="x" * (MEGABYTES << 20)))
        rclpy.spin_once(node, timeout_sec=0.1)


main()
