#!/usr/bin/env python3
"""Requests all parameters of a node in single calls, and reads its discovery data: only the hardened build provides these between hosts.

Prints one JSON line: the numbers of parameters that were listed, described and read; by topic the type hash that the node announces
and the hash that rclpy announces for the same type; the node's enclave. Run it through ros-python.sh.
"""

import argparse
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient

from peer_common import emit, fail
from ros_common import TYPES, full_names, qos, wait_until

ANSWER = 10.0


def shown(info):
    """A type hash as `ros2 topic info -v` writes it; version 0 without a value is INVALID."""
    value = bytes(info.topic_type_hash.value)
    return f"RIHS{info.topic_type_hash.version:02}_{value.hex()}" if any(value) else "INVALID"


def hashes(node, topic):
    infos = node.get_publishers_info_by_topic(topic) + node.get_subscriptions_info_by_topic(topic)
    return sorted({shown(info) for info in infos})


class Asker:
    def __init__(self, node, executor, name):
        self.executor, self.seconds = executor, {}
        self.client = AsyncParameterClient(node, name)
        if not self.client.wait_for_services(ANSWER):
            fail(f"{name} offers no parameter services within {ANSWER:g} s")

    def ask(self, what, future):
        began = time.monotonic()
        self.executor.spin_until_future_complete(future, timeout_sec=ANSWER)
        if not future.done():
            fail(f"{what}: no answer within {ANSWER:g} s")
        self.seconds[what] = time.monotonic() - began
        return future.result()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--node", default="/mr_damper", help="fully qualified name of the node")
    args = parser.parse_args()
    rclpy.init()
    node = Node("details_peer")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    wait_until(lambda: args.node in full_names(node), executor, 20.0, f"{args.node} is not in the graph")
    own = {topic: f"/details_peer/{topic}" for topic in ("displacement", "force_estimate", "mode")}
    kept = [node.create_publisher(TYPES[topic], name, qos(1)) for topic, name in own.items()]
    asker = Asker(node, executor, args.node)
    names = asker.ask("list_parameters", asker.client.list_parameters(None)).result.names
    described = asker.ask("describe_parameters", asker.client.describe_parameters(names)).descriptors
    values = asker.ask("get_parameters", asker.client.get_parameters(names)).values
    enclaves = {
        f"{space.rstrip('/')}/{name}": enclave
        for name, space, enclave in node.get_node_names_and_namespaces_with_enclaves()
    }
    emit(
        {
            "listed": len(names),
            "described": sum(bool(d.description) for d in described),
            "got": sum(value.type != 0 for value in values),
            "seconds": asker.seconds,
            "hashes": {topic: hashes(node, f"/{topic}") for topic in own},
            "own_hashes": {topic: hashes(node, name) for topic, name in own.items()},
            "service_hash": hashes(node, f"rq{args.node}/get_parametersRequest"),
            "enclave": enclaves.get(args.node),
        }
    )
    del kept
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


main()
