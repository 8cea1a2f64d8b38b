"""Watches the nodes of a launch file: prints the parameters of each once it appears, and reports when all have disappeared.

usage: launch_peer.py PARAMETER[,PARAMETER...] NODE...
"""

import sys
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from peer_common import emit, fail
from ros_common import full_names, wait_until

SECONDS = 20.0


def main():
    parameters, nodes = sys.argv[1].split(","), sys.argv[2:]
    rclpy.init()
    watcher = Node("launch_peer")
    executor = SingleThreadedExecutor()
    executor.add_node(watcher)
    wait_until(lambda: set(nodes) <= set(full_names(watcher)), executor, SECONDS, f"not all of {nodes} are in the graph")
    told = {}
    for node in nodes:
        client = AsyncParameterClient(watcher, node)
        if not client.wait_for_services(timeout_sec=SECONDS):
            fail(f"{node} has no parameter services (seen: {full_names(watcher)})")
        answer = client.get_parameters(parameters)
        executor.spin_until_future_complete(answer, timeout_sec=SECONDS)
        if not answer.done():
            fail(f"{node} does not return the parameters {parameters}")
        told[node] = dict(zip(parameters, map(parameter_value_to_python, answer.result().values)))
    emit({"nodes": told})
    deadline = time.monotonic() + 60.0
    while set(nodes) & set(full_names(watcher)):
        if time.monotonic() > deadline:
            fail(f"still in the graph: {full_names(watcher)}")
        time.sleep(0.01)
    emit({"event": "gone"})
    executor.shutdown()
    watcher.destroy_node()
    rclpy.shutdown()


main()
