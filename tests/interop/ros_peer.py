#!/usr/bin/env python3
"""An rclpy user of the node: sends its inputs, receives its outputs, reads the graph, changes a parameter.

Prints one JSON line. It only reports what this peer saw; tests/interop.rs checks the values.
Run it through ros-python.sh. `--against echo` is for the bare echo, which has neither residual nor parameters.
"""

import argparse
import math
import os
import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from mr_damper_msgs.srv import LoadModel
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from peer_common import (
    INPUTS,
    OUTPUTS,
    WARM_UP,
    Pace,
    answers,
    emit,
    fail,
    mode_changes,
    residuals,
    samples,
    since,
)
from ros_common import TYPES, full_names, message, qos, to_ns, wait_until

QUEUE = 4000  # all messages of a run: on a loaded machine this process reads them late, and a shorter queue drops the oldest
SERVICE_TIMEOUT = 10.0  # a first call to a ros2-client server can take 3 s


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--node", default="/mr_damper", help="fully qualified name of the node")
    parser.add_argument("--against", choices=["node", "echo"], default="node")
    parser.add_argument("--csv", help="run to send; default: a sine")
    parser.add_argument("--rate", type=float, default=512.0, help="samples per second")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument(
        "--force-seconds", type=float, default=math.inf, help="measured force stops after this long"
    )
    parser.add_argument("--list-below", help="list only the parameters below this prefix")
    return parser.parse_args()


class Peer:
    """Publishers, subscriptions and received messages."""

    def __init__(self, args):
        self.args = args
        self.namespace, _, self.name = args.node.rpartition("/")
        self.node = Node("interop_peer", namespace=self.namespace or "/")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.outputs = OUTPUTS if args.against == "node" else ("force_estimate",)
        self.inputs = INPUTS if args.against == "node" else ("displacement",)
        self.publishers = {t: self.node.create_publisher(TYPES[t], t, qos(100)) for t in self.inputs}
        self.received = {topic: [] for topic in self.outputs}
        for topic in self.outputs:
            self.node.create_subscription(TYPES[topic], topic, self.received[topic].append, qos(QUEUE))
        self.diagnostics = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self.diagnostics.append, qos(10))
        self.sent = {topic: [] for topic in self.inputs}
        self.counted_from = 0

    def wait_for_node(self):
        topics = {f"{self.namespace}/{topic}" for topic in self.outputs}
        wait_until(
            lambda: self.args.node in full_names(self.node)
            and all(p.get_subscription_count() > 0 for p in self.publishers.values())
            and all(self.node.count_publishers(topic) > 0 for topic in topics),
            self.executor,
            15.0,
            f"{self.args.node} with its topics is not in the graph (seen: {full_names(self.node)})",
        )

    def publish(self, topic, ns, value):
        self.publishers[topic].publish(message(topic, ns, value))
        if ns >= self.counted_from:
            self.sent[topic].append(ns)

    def send(self):
        """Sends the run: current and force before the displacement that triggers the node's step."""
        # The peer discovers the node's readers shortly before the node discovers these writers; volatile
        # writers drop samples sent in between. So inputs are sent until each of them was answered.
        awaited = [topic for topic in ("force_estimate", "force_residual") if topic in self.outputs]
        knocks = 0
        while not all(self.received[topic] for topic in awaited):
            if knocks == 200:
                seen = {topic: len(self.received[topic]) for topic in awaited}
                fail(f"200 samples of each input in 10 s did not bring an answer on each topic: {seen}")
            ns = time.time_ns()
            for topic in ("coil_current", "measured_force", "displacement"):
                if topic in self.inputs:
                    self.publishers[topic].publish(message(topic, ns, 0.0))
            knocks += 1
            self.executor.spin_once(timeout_sec=0.05)
        self.spin_for(0.3)
        for topic in awaited:
            self.received[topic].clear()

        pace = Pace(self.args.rate)
        self.counted_from = pace.first_ns + round(WARM_UP * 1e9)
        started = time.perf_counter()
        seconds = WARM_UP + self.args.seconds
        for displacement, current, force in samples(self.args.csv, self.args.rate, seconds):
            while (remaining := pace.remaining()) > 0:
                self.executor.spin_once(timeout_sec=remaining)
            ns = pace.stamp_ns()
            if "coil_current" in self.inputs:
                self.publish("coil_current", ns, current)
            if "measured_force" in self.inputs and time.perf_counter() - started < self.args.force_seconds:
                self.publish("measured_force", ns, force)
            self.publish("displacement", ns, displacement)
            pace.advance()
        self.spin_for(1.0)
        return {"knocks": knocks, "latest_ms": pace.latest * 1e3}

    def spin_for(self, seconds):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def graph(self):
        def table(pairs):
            return {name: sorted(types) for name, types in pairs}

        namespace = self.namespace or "/"
        return {
            "nodes": full_names(self.node),
            "topics": table(self.node.get_topic_names_and_types()),
            "published": table(self.node.get_publisher_names_and_types_by_node(self.name, namespace)),
            "subscribed": table(self.node.get_subscriber_names_and_types_by_node(self.name, namespace)),
            "services": table(self.node.get_service_names_and_types_by_node(self.name, namespace)),
        }

    def parameters(self):
        """Lists, describes and sets parameters, tries invalid values, and reads back."""
        client = AsyncParameterClient(self.node, self.args.node)
        # rclpy's wait_for_services also waits for services that ros2-client does not offer, so wait for
        # the calls instead.
        result = {}
        below = [self.args.list_below] if self.args.list_below else None
        listed = self.call("list_parameters", client.list_parameters(below))
        result["listed"] = sorted(listed.result.names)
        described = self.call("describe_parameters", client.describe_parameters(["coast_s", "model"]))
        result["described"] = {d.name: d.type for d in described.descriptors}
        result["before"] = self.read(client)
        result["set"] = self.set(client, "coast_s", 0.75)
        result["after_set"] = self.read(client)
        result["refused_range"] = self.set(client, "coast_s", -1.0)
        result["refused_type"] = self.set(client, "coast_s", "long")
        result["refused_name"] = self.set(client, "coats_s", 0.5)
        result["after_refusals"] = self.read(client)
        return result

    def read(self, client):
        return self.call("get_parameters", client.get_parameters(["coast_s"])).values[0].double_value

    def set(self, client, name, value):
        answer = self.call("set_parameters", client.set_parameters([Parameter(name, value=value)])).results[0]
        return {"successful": answer.successful, "reason": answer.reason}

    def models(self, known, unknown):
        """Loads one model, and requests one that must be refused."""
        client = self.node.create_client(LoadModel, "load_model")
        if not client.wait_for_service(SERVICE_TIMEOUT):
            fail(f"{self.args.node} does not offer load_model")
        answers = {}
        for what, model in (("loaded", known), ("refused", unknown)):
            answer = self.call("load_model", client.call_async(LoadModel.Request(model=model)))
            answers[what] = {"success": answer.success, "message": answer.message}
        parameters = AsyncParameterClient(self.node, self.args.node)
        values = self.call("get_parameters", parameters.get_parameters(["model"])).values
        return {**answers, "parameter": values[0].string_value}

    def call(self, what, future):
        self.executor.spin_until_future_complete(future, timeout_sec=SERVICE_TIMEOUT)
        if not future.done():
            fail(f"{self.args.node}/{what} did not answer within {SERVICE_TIMEOUT:g} s")
        return future.result()


def main():
    args = arguments()
    rclpy.init()
    peer = Peer(args)
    peer.wait_for_node()
    result = {"peer": "rclpy", "distro": os.environ.get("ROS_DISTRO"), "python": sys.version.split()[0]}
    result["sending"] = peer.send()
    result["sent"] = {topic: len(stamps) for topic, stamps in peer.sent.items()}
    counted = {topic: since(peer.counted_from, peer.received[topic], to_ns) for topic in peer.outputs}
    result["force_estimate"] = answers(peer.sent["displacement"], counted["force_estimate"], to_ns)
    if args.against == "node":
        result["force_residual"] = residuals(peer.sent["measured_force"], counted["force_residual"], to_ns)
        result["mode"] = mode_changes(peer.received["mode"])
    result["graph"] = peer.graph()
    if args.against == "node":
        result["parameters"] = peer.parameters()
        result["models"] = peer.models("thesis/fuzzy-tanh/rp1-cs", "/no/such/model.toml")
        result["diagnostics"] = [
            {"name": s.name, "level": ord(s.level), "message": s.message, "keys": [v.key for v in s.values]}
            for array in peer.diagnostics
            for s in array.status
        ]
    emit(result)
    peer.executor.shutdown()
    peer.node.destroy_node()
    rclpy.shutdown()


main()
