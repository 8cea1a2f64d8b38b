#!/usr/bin/env python3
"""An rclpy client, on another host or on this one, that requests responses longer than a network datagram.

Requests a type with its sources, and the list of all parameters. Prints one JSON line that reports which responses arrived and whether
they were complete. Run it through ros-python.sh.
"""

import argparse

import rclpy
from rcl_interfaces.srv import DescribeParameters, ListParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from type_description_interfaces.srv import GetTypeDescription

from peer_common import emit, fail

FIND = 20.0  # s
ANSWER = 6.0  # a first answer can take 3 s


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--node", default="/mr_damper")
    args = parser.parse_args()
    rclpy.init()
    node = Node("interop_far")
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def ask(kind, name, request):
        client = node.create_client(kind, f"{args.node}/{name}")
        if not client.wait_for_service(FIND):
            fail(f"{name} was not found within {FIND:g} s; is the node running in this ROS_DOMAIN_ID?")
        answer = client.call_async(request)
        executor.spin_until_future_complete(answer, timeout_sec=ANSWER)
        return answer.result() if answer.done() else None

    described = ask(
        GetTypeDescription,
        "get_type_description",
        GetTypeDescription.Request(type_name="mr_damper_msgs/msg/ForceEstimate", include_type_sources=True),
    )
    short = ask(ListParameters, "list_parameters", ListParameters.Request(prefixes=["current"]))
    listed = ask(ListParameters, "list_parameters", ListParameters.Request())
    names = listed.result.names if listed else []
    emit(
        {
            "type_answered": described is not None,
            "type_sources": len(described.type_sources) if described else 0,
            "type_told": [f"{pair.key}: {pair.value}" for pair in described.extra_information] + [described.failure_reason]
            if described
            else [],
            "listed_below": len(short.result.names) if short else 0,
            "listed": len(names),
        }
    )


if __name__ == "__main__":
    main()
