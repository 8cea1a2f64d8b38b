#!/usr/bin/env python3
"""An rclpy supervisor: requests valid and invalid forces from the node, and then stops sending.

Prints one JSON line: for each phase the commands and their limits, the reasons of the estimates, and their intervals. tests/interop.rs
checks the values. Run it through ros-python.sh.
"""

import argparse
import math
import os
import time
from collections import Counter

import rclpy
from mr_damper_msgs.msg import CurrentCommand, ForceEstimate
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import Pace, emit, fail, samples
from ros_common import TYPES, message, qos, wait_until

RATE = 256.0
PHASE = 2.0  # seconds; the first third of each phase is ignored, because it still shows the previous phase
INPUTS = ("displacement", "coil_current", "measured_force", "force_request")
OUTPUTS = ("current_command", "force_estimate")


def named(message_type, prefix):
    """The constants of a message that begin with `prefix`, by value."""
    names = [name for name in dir(message_type) if name.startswith(prefix)]
    return {getattr(message_type, name): name[len(prefix) :] for name in names}


LIMITED_BY = named(CurrentCommand, "LIMITED_BY_")
REASONS = named(ForceEstimate, "REASON_")

# The requested force of each phase, given the measured force; None: no request.
PHASES = {
    "follow": lambda force: 0.7 * force,
    "not_a_number": lambda force: math.nan,
    "too_large": lambda force: 50_000.0,
    "bad_load_cell": lambda force: 0.7 * force,
    "unasked": lambda force: None,
}


class Peer:
    def __init__(self, name):
        namespace, _, self.node_name = name.rpartition("/")
        self.node = Node("interop_supervisor", namespace=namespace or "/")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.publishers = {t: self.node.create_publisher(TYPES[t], t, qos(100)) for t in INPUTS}
        self.received = {topic: [] for topic in OUTPUTS}
        for topic in OUTPUTS:
            self.node.create_subscription(TYPES[topic], topic, self.received[topic].append, qos(1000))

    def wait_for_node(self):
        wait_until(
            lambda: all(p.get_subscription_count() > 0 for p in self.publishers.values())
            and all(self.node.count_publishers(topic) > 0 for topic in OUTPUTS),
            self.executor,
            15.0,
            f"{self.node_name} does not subscribe to {INPUTS} and publish {OUTPUTS}",
        )
        deadline = time.monotonic() + 10.0
        while not self.received["force_estimate"]:
            if time.monotonic() > deadline:
                fail("no force_estimate came back for displacements sent for 10 s")
            ns = time.time_ns()
            for topic in ("coil_current", "displacement"):
                self.publishers[topic].publish(message(topic, ns, 0.0))
            self.spin_for(0.05)

    def spin_for(self, seconds):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def act(self, phase, ask):
        """Sends motion for a phase with the requests of `ask`, and summarises the messages of its last two thirds."""
        pace, begun = Pace(RATE), time.monotonic()
        for displacement, current, force in samples(None, RATE, PHASE):
            while (remaining := pace.remaining()) > 0:
                self.executor.spin_once(timeout_sec=remaining)
            if time.monotonic() - begun < PHASE / 3:
                for messages in self.received.values():
                    messages.clear()
            ns = pace.stamp_ns()
            wanted = ask(force)
            if wanted is not None:
                self.publishers["force_request"].publish(message("force_request", ns, wanted))
            self.publishers["coil_current"].publish(message("coil_current", ns, current))
            cell = 1e7 if phase == "bad_load_cell" and pace.count % 16 == 0 else force
            self.publishers["measured_force"].publish(message("measured_force", ns, cell))
            self.publishers["displacement"].publish(message("displacement", ns, displacement))
            pace.advance()
        return self.told()

    def told(self):
        commands, estimates = self.received["current_command"], self.received["force_estimate"]
        reasons = Counter(
            name for e in estimates for value, name in REASONS.items() if e.reasons & value
        )
        inside = [c for c in commands if math.isfinite(c.achievable_min)]
        banded = [e for e in estimates if math.isfinite(e.band_low)]
        return {
            "commands": len(commands),
            "limited_by": Counter(LIMITED_BY[c.limited_by] for c in commands),
            "current": {
                "least": min((c.current for c in commands), default=None),
                "most": max((c.current for c in commands), default=None),
                "last": commands[-1].current if commands else None,
            },
            "with_interval": len(inside),
            "interval_holds": all(
                c.achievable_min - 1.0 <= c.force_expected <= c.achievable_max + 1.0 for c in inside
            ),
            "estimates": len(estimates),
            "reasons": reasons,
            "banded": len(banded),
            "band_holds_force": all(e.band_low < e.force < e.band_high for e in banded),
        }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--node", default="/mr_damper", help="fully qualified name of the node")
    args = parser.parse_args()
    rclpy.init()
    peer = Peer(args.node)
    peer.wait_for_node()
    result = {"peer": "rclpy", "distro": os.environ.get("ROS_DISTRO")}
    unasked = len(peer.received["current_command"])
    result["before_anything_was_asked"] = unasked
    for phase, ask in PHASES.items():
        result[phase] = peer.act(phase, ask)
    for messages in peer.received.values():
        messages.clear()
    peer.spin_for(1.5)
    result["silence"] = peer.told()
    emit(result)
    peer.executor.shutdown()
    peer.node.destroy_node()
    rclpy.shutdown()


main()
