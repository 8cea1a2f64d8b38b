#!/usr/bin/env python3
"""Compares the node's standard messages with its own messages.

Sends displacement, coil current and demanded force at 100 Hz for some seconds. Prints one JSON line: how many estimates and commands came,
how many wrenches and joint states had an estimate's stamp, how many of the values were another one (NaN counts as equal only to an estimate
that is neither valid nor degraded), and the joint. Numbers without a stamp are compared as sequences. Run it through ros-python.sh.
"""

import argparse
import math
import threading
import time

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from peer_common import emit
from ros_common import TYPES, message, qos, to_ns, wait_until

PERIOD = 0.01
INPUTS = ("coil_current", "force_request", "displacement")
DEGRADED = 1
OUTPUTS = {
    "force_estimate": TYPES["force_estimate"],
    "current_command": TYPES["current_command"],
    "force_estimate_wrench": WrenchStamped,
    "force_estimate_joint_state": JointState,
    "force_estimate_float64": Float64,
    "current_command_float64": Float64,
}


def expected(estimate):
    return estimate.force if estimate.validity <= DEGRADED else math.nan


def same(a, b):
    return a == b or (math.isnan(a) and math.isnan(b))


def follow(numbers, values):
    """Whether both are the same sequence; commands go on without displacement, so one may be ahead at the end."""
    return abs(len(numbers) - len(values)) <= 2 and all(map(same, numbers, values))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--axis", default="z")
    args = parser.parse_args()
    rclpy.init()
    node = Node("standard_peer")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    heard = {topic: [] for topic in OUTPUTS}
    for topic, kind in OUTPUTS.items():
        node.create_subscription(kind, topic, heard[topic].append, qos(2000))
    publishers = {topic: node.create_publisher(TYPES[topic], topic, qos(10)) for topic in INPUTS}
    there = lambda: all(p.get_subscription_count() > 0 for p in publishers.values()) and all(  # noqa: E731
        node.count_publishers(topic) > 0 for topic in OUTPUTS
    )
    wait_until(there, executor, 20.0, "the node does not have all topics")
    # Messages are taken while others are sent: six of them answer each displacement.
    ended = threading.Event()

    def read():
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.02)

    reader = threading.Thread(target=read)
    reader.start()
    time.sleep(0.3)
    end = time.monotonic() + args.seconds
    while time.monotonic() < end:
        ns = time.time_ns()
        t = ns * 1e-9 % 1000.0
        values = {
            "coil_current": 0.4,
            "force_request": 200.0,
            "displacement": 0.008 * math.sin(4 * math.pi * t),
        }
        for topic, publisher in publishers.items():
            publisher.publish(message(topic, ns, values[topic]))
        time.sleep(PERIOD)
    # What is still on its way.
    time.sleep(1.0)
    ended.set()
    reader.join()
    # A held estimate has the stamp of the one before it.
    at = {}
    for estimate in heard["force_estimate"]:
        at.setdefault(to_ns(estimate.header.stamp), []).append(expected(estimate))
    wrenches = [m for m in heard["force_estimate_wrench"] if to_ns(m.header.stamp) in at]
    joints = [m for m in heard["force_estimate_joint_state"] if to_ns(m.header.stamp) in at]
    known = lambda m, value: any(same(value, force) for force in at[to_ns(m.header.stamp)])  # noqa: E731
    forces = [expected(e) for e in heard["force_estimate"]]
    numbers = [m.data for m in heard["force_estimate_float64"]]
    currents = [m.current for m in heard["current_command"]]
    commands = [m.data for m in heard["current_command_float64"]]
    emit(
        {
            "estimates": len(forces),
            "usable": sum(not math.isnan(force) for force in forces),
            "commands": len(currents),
            "wrenches": len(wrenches),
            "joint_states": len(joints),
            "numbers": len(numbers),
            "other_wrenches": sum(not known(m, getattr(m.wrench.force, args.axis)) for m in wrenches),
            "other_joint_states": sum(not known(m, m.effort[0]) for m in joints),
            "same_numbers": follow(numbers, forces),
            "same_commands": follow(commands, currents),
            "joint": joints[0].name[0] if joints else "",
        }
    )
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


main()
