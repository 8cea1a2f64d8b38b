#!/usr/bin/env python3
"""New clients in a running participant: measures how long each waits for its first response.

Creates `--clients` clients of the node's service `get_state`, one after another, calls each once and destroys it. Prints one JSON line.
Run it through ros-python.sh, in its own network namespace:

  tests/interop/netns.sh run bash -c 'mr-damper node --model thesis/fuzzy-tanh/rp3-cs & sleep 3;
    tests/interop/ros-python.sh jazzy tests/interop/new_clients.py; kill $!'
"""

import argparse
import time

import rclpy
from lifecycle_msgs.srv import GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import emit, fail

LATE = 0.2  # s


def wait_of(node, executor, service, limit):
    """Seconds from creating a client to its response, including the wait for the service."""
    began = time.monotonic()
    client = node.create_client(GetState, service)
    if not client.wait_for_service(timeout_sec=limit):
        fail(f"{service} was not found within {limit:g} s")
    answer = client.call_async(GetState.Request())
    executor.spin_until_future_complete(answer, timeout_sec=limit)
    seconds = time.monotonic() - began
    node.destroy_client(client)
    return seconds if answer.done() else None


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--service", default="/mr_damper/get_state")
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--limit", type=float, default=10.0, help="longest wait for an answer, s")
    args = parser.parse_args()
    rclpy.init()
    node = Node("interop_new_clients")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    wait_of(node, executor, args.service, args.limit)  # the participants discover each other
    waits = [wait_of(node, executor, args.service, args.limit) for _ in range(args.clients)]
    answered = sorted(wait for wait in waits if wait is not None)
    emit(
        {
            "clients": len(waits),
            "unanswered": len(waits) - len(answered),
            "late": sum(wait > LATE for wait in answered),
            "median_s": round(answered[len(answered) // 2], 4),
            "longest_s": [round(wait, 3) for wait in answered[-12:]],
        }
    )


if __name__ == "__main__":
    main()
