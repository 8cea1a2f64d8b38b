#!/usr/bin/env python3
"""An rclpy client of the action close_loop: sends goals, receives feedback, has a goal refused and one cancelled, and loads the new model.

Prints one JSON line, which tests/interop.rs checks. Run it through ros-python.sh, with a node that has a minute of history.
"""

import argparse
import json
import os

import rclpy
from action_msgs.msg import GoalStatus
from mr_damper_msgs.action import CloseLoop
from mr_damper_msgs.srv import LoadModel
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from peer_common import emit, fail

ANSWER = 10.0  # a first call to a ros2-client server can take 3 s
RESULT = 60.0
STATUS = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_ABORTED: "aborted",
    GoalStatus.STATUS_CANCELED: "canceled",
}


class Peer:
    def __init__(self, namespace):
        self.node = Node("interop_close_peer", namespace=namespace)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.action = ActionClient(self.node, CloseLoop, "close_loop")
        self.load_model = self.node.create_client(LoadModel, "load_model")
        if not self.action.wait_for_server(ANSWER) or not self.load_model.wait_for_service(ANSWER):
            fail(f"no node offers close_loop and load_model in {namespace} within {ANSWER:g} s")

    def wait(self, what, future, seconds=ANSWER):
        self.executor.spin_until_future_complete(future, timeout_sec=seconds)
        if not future.done():
            fail(f"{what}: no answer within {seconds:g} s")
        return future.result()

    def send(self, history, feedback=None):
        def hear(message):
            if feedback is not None:
                feedback.append([message.feedback.stage, message.feedback.progress])

        future = self.action.send_goal_async(CloseLoop.Goal(history=history), feedback_callback=hear)
        return self.wait("send_goal", future)

    def result(self, goal):
        answer = self.wait("get_result", goal.get_result_async(), RESULT)
        report = json.loads(answer.result.report)
        status = STATUS.get(answer.status, str(answer.status))
        return {"status": status, "success": answer.result.success, "report": report}

    def load(self, model):
        answer = self.wait("load_model", self.load_model.call_async(LoadModel.Request(model=model)))
        return {"success": answer.success, "message": answer.message}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--namespace", default="/")
    parser.add_argument("--history", type=float, default=60.0)
    args = parser.parse_args()
    rclpy.init()
    peer = Peer(args.namespace)
    result = {"peer": "rclpy", "distro": os.environ.get("ROS_DISTRO")}

    result["refused"] = peer.send(-1.0).accepted
    feedback = []
    goal = peer.send(args.history, feedback)
    if not goal.accepted:
        fail(f"a goal of {args.history:g} s is not accepted")
    result["second"] = peer.send(args.history).accepted
    result["closed"] = peer.result(goal)
    result["feedback"] = feedback

    goal = peer.send(args.history)
    cancelled = peer.wait("cancel_goal", goal.cancel_goal_async())
    result["cancelling"] = len(cancelled.goals_canceling)
    result["cancelled"] = peer.result(goal)

    model = result["closed"]["report"].get("model_file")
    result["loaded"] = peer.load(model) if model else None
    emit(result)
    peer.action.destroy()
    peer.executor.shutdown()
    peer.node.destroy_node()
    rclpy.shutdown()


main()
