"""Shared by the rclpy peers: messages, QoS, waiting for the graph."""

import time

from builtin_interfaces.msg import Time
from mr_damper_msgs.msg import (
    CoilCurrent,
    CurrentCommand,
    Displacement,
    Force,
    ForceEstimate,
    ForceResidual,
    ModeChange,
)
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from peer_common import fail

TYPES = {
    "displacement": Displacement,
    "coil_current": CoilCurrent,
    "measured_force": Force,
    "force_estimate": ForceEstimate,
    "force_residual": ForceResidual,
    "mode": ModeChange,
    "force_request": Force,
    "current_command": CurrentCommand,
}


def qos(depth):
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def to_ns(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def to_stamp(ns):
    return Time(sec=ns // 1_000_000_000, nanosec=ns % 1_000_000_000)


def message(topic, ns, value):
    """An input message with its stamp and its value."""
    result = TYPES[topic]()
    result.header.stamp = to_stamp(ns)
    field = {"displacement": "displacement", "coil_current": "current"}
    setattr(result, field.get(topic, "force"), value)
    return result


def wait_until(condition, executor, seconds, what):
    """Spins until `condition()` is true; ends the peer if that takes longer than `seconds`."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            fail(f"after {seconds:g} s {what}; is the node running in this ROS_DOMAIN_ID and namespace?")
        executor.spin_once(timeout_sec=0.02)


def full_names(node):
    """Fully qualified names of all nodes in the graph."""
    return sorted(
        f"{namespace.rstrip('/')}/{name}" for name, namespace in node.get_node_names_and_namespaces()
    )
