#!/usr/bin/env python3
"""An rclpy manager of the node: takes it through its states, describes and sets its parameters, holds its mode, resets it, requests a
type, reads its log, provides the time, and lets it design a run and identify a model.

The node must run as `corner/damper`, without autostart, with `displacement` renamed to `/lvdt/x` and `reset` to `forget`.
Prints one JSON line, which tests/interop.rs checks. Run it through ros-python.sh.
"""

import argparse
import os
import time

import rclpy
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from mr_damper_msgs.action import Design, Identify
from mr_damper_msgs.msg import ForceEstimate
from mr_damper_msgs.srv import LoadModel, Reset, SetMode
from rcl_interfaces.msg import Log, ParameterEvent
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParametersAtomically
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from type_description_interfaces.srv import GetTypeDescription

from peer_common import Pace, emit, fail, samples
from ros_common import TYPES, full_names, message, qos, to_ns, to_stamp

ANSWER = 10.0  # a first call to a ros2-client server can take 3 s
RATE = 256.0
NAME = "/corner/damper"
STATUS = {
    GoalStatus.STATUS_SUCCEEDED: "succeeded",
    GoalStatus.STATUS_ABORTED: "aborted",
    GoalStatus.STATUS_CANCELED: "canceled",
}


class Peer:
    def __init__(self):
        self.node = Node("interop_manager", namespace="/corner")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.clients = {}
        self.heard = {}
        late = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.hear("log", Log, "/rosout", late)
        self.hear("events", TransitionEvent, f"{NAME}/transition_event", qos(100))
        self.hear("parameters", ParameterEvent, "/parameter_events", qos(100))
        self.hear("estimates", ForceEstimate, "force_estimate", qos(5000))
        self.hear("diagnostics", DiagnosticArray, "/diagnostics", qos(100))
        topics = {"displacement": "/lvdt/x", "coil_current": "coil_current", "measured_force": "measured_force"}
        self.inputs = {t: self.node.create_publisher(TYPES[t], name, qos(100)) for t, name in topics.items()}
        self.clock = self.node.create_publisher(Clock, "/clock", qos(10))

    def hear(self, what, kind, topic, profile):
        self.heard[what] = []
        self.node.create_subscription(kind, topic, self.heard[what].append, profile)

    def spin_for(self, seconds):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def wait(self, what, future, seconds=ANSWER):
        self.executor.spin_until_future_complete(future, timeout_sec=seconds)
        if not future.done():
            fail(f"{what}: no answer within {seconds:g} s")
        return future.result()

    def call(self, kind, name, request=None):
        if name not in self.clients:
            self.clients[name] = self.node.create_client(kind, name)
            if not self.clients[name].wait_for_service(ANSWER):
                fail(f"no node offers {name} within {ANSWER:g} s; services: {self.node.get_service_names_and_types()}")
        return self.wait(name, self.clients[name].call_async(request or kind.Request()))

    def state(self):
        return self.call(GetState, f"{NAME}/get_state").current_state.label

    def change(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.call(ChangeState, f"{NAME}/change_state", request).success

    def transitions(self, which):
        answer = self.call(GetAvailableTransitions, f"{NAME}/{which}")
        return [
            [t.start_state.label, t.transition.label, t.goal_state.label] for t in answer.available_transitions
        ]

    def set(self, **values):
        """Sets parameters atomically; `__` in a name stands for a dot."""
        parameters = [
            Parameter(name.replace("__", "."), value=value).to_parameter_msg() for name, value in values.items()
        ]
        name = f"{NAME}/set_parameters_atomically"
        result = self.call(SetParametersAtomically, name, SetParametersAtomically.Request(parameters=parameters))
        return {"successful": result.result.successful, "reason": result.result.reason}

    def get(self, name):
        answer = self.call(GetParameters, f"{NAME}/get_parameters", GetParameters.Request(names=[name]))
        return answer.values[0]

    def move(self, seconds, from_ns=None, clock=False):
        """Sends motion, and returns the number of estimates with its stamps and their modes."""
        self.heard["estimates"].clear()
        sent, pace = set(), Pace(RATE)
        for displacement, current, force in samples(None, RATE, seconds):
            while (remaining := pace.remaining()) > 0:
                self.executor.spin_once(timeout_sec=remaining)
            ns = pace.stamp_ns() if from_ns is None else from_ns + pace.stamp_ns() - pace.first_ns
            sent.add(ns)
            if clock:
                self.clock.publish(Clock(clock=to_stamp(ns)))
            for topic, value in (("coil_current", current), ("measured_force", force), ("displacement", displacement)):
                self.inputs[topic].publish(message(topic, ns, value))
            pace.advance()
        self.spin_for(0.3)
        got = [e for e in self.heard["estimates"] if to_ns(e.header.stamp) in sent]
        return {"sent": len(sent), "estimates": len(got), "modes": sorted({e.mode for e in got[len(got) // 2 :]})}

    def lines(self):
        return [[line.level, line.name, line.msg] for line in self.heard["log"] if "interop" not in line.name]


def described(peer):
    names = ["coast_s", "domain_id", "law", "displacement.sign", "no.such"]
    request = DescribeParameters.Request(names=names)
    answer = peer.call(DescribeParameters, f"{NAME}/describe_parameters", request)
    return {
        d.name: {
            "type": d.type,
            "description": d.description,
            "constraints": d.additional_constraints,
            "read_only": d.read_only,
            "range": [[r.from_value, r.to_value, r.step] for r in d.floating_point_range]
            + [[r.from_value, r.to_value, r.step] for r in d.integer_range],
        }
        for d in answer.descriptors
    }


def act(peer, kind, name, goal, cancel=False):
    """Sends a goal and waits for its result: its fields, its status, and the stages of the feedback."""
    action = ActionClient(peer.node, kind, name)
    if not action.wait_for_server(ANSWER):
        fail(f"no node offers the action {name}")
    stages = []
    handle = peer.wait(
        "send_goal",
        action.send_goal_async(
            goal, feedback_callback=lambda told: stages.append([told.feedback.stage, told.feedback.progress])
        ),
    )
    if not handle.accepted:
        return {"accepted": False}
    if cancel:
        peer.wait("cancel_goal", handle.cancel_goal_async())
    answer = peer.wait("get_result", handle.get_result_async(), 60.0)
    action.destroy()
    return {
        "accepted": True,
        "status": STATUS.get(answer.status, str(answer.status)),
        "stages": stages,
        **{field: getattr(answer.result, field) for field in answer.result.get_fields_and_field_types()},
    }


def identify(peer, model, cancel=False):
    return act(peer, Identify, "identify", Identify.Goal(model=model, history=60.0), cancel)


def design(peer, cancel=False, **goal):
    limits = {"stroke": 0.02, "speed": 0.4, "drive_max": 2.0, "duration": 12.0, "rate": 128.0, "noise": 2.0}
    return act(peer, Design, "design", Design.Goal(**limits, **goal), cancel)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", required=True, help="a preset that loads")
    args = parser.parse_args()
    rclpy.init()
    peer = Peer()
    result = {"peer": "rclpy", "distro": os.environ.get("ROS_DISTRO")}

    result["first_state"] = peer.state()
    result["nodes"] = full_names(peer.node)
    answer = peer.call(GetAvailableStates, f"{NAME}/get_available_states")
    result["states"] = [state.label for state in answer.available_states]
    result["graph"] = peer.transitions("get_transition_graph")
    result["unasked"] = peer.move(0.5)
    result["bad_model"] = [peer.set(model="/no/such/model.toml"), peer.change(Transition.TRANSITION_CONFIGURE)]
    result["good_model"] = [peer.set(model=args.model), peer.change(Transition.TRANSITION_CONFIGURE)]
    result["ways_when_inactive"] = [way[1] for way in peer.transitions("get_available_transitions")]
    result["inactive"] = peer.move(0.5)
    result["activated"] = [peer.change(Transition.TRANSITION_ACTIVATE), peer.state()]
    result["active"] = peer.move(2.0)

    result["described"] = described(peer)
    listed = peer.call(ListParameters, f"{NAME}/list_parameters", ListParameters.Request(prefixes=["current"], depth=1))
    result["listed"] = [sorted(listed.result.names), list(listed.result.prefixes)]
    peer.heard["parameters"].clear()
    result["refused"] = peer.set(coast_s=0.7, hold_s=-1.0)
    result["after_refusal"] = peer.get("coast_s").double_value
    result["set"] = peer.set(coast_s=0.7, current__safe_a=0.1)
    result["model_when_active"] = peer.set(model="thesis/fuzzy-tanh/rp1-cs")
    peer.spin_for(0.3)
    result["parameter_events"] = [
        [event.node, [p.name for p in event.changed_parameters]] for event in peer.heard["parameters"]
    ]

    result["mode_fault"] = peer.call(SetMode, "set_mode", SetMode.Request(mode=ForceEstimate.MODE_FAULT)).success
    result["held"] = peer.move(0.5)
    result["mode_hold"] = peer.call(SetMode, "set_mode", SetMode.Request(mode=ForceEstimate.MODE_HOLD)).message
    result["mode_auto"] = peer.call(SetMode, "set_mode", SetMode.Request(automatic=True)).success
    result["reset"] = peer.call(Reset, "forget").success
    request = GetTypeDescription.Request(type_name="mr_damper_msgs/msg/ForceEstimate", include_type_sources=True)
    answer = peer.call(GetTypeDescription, f"{NAME}/get_type_description", request)
    description = answer.type_description.type_description
    result["type"] = {
        "successful": answer.successful,
        "fields": [field.name for field in description.fields],
        "sources": [source.type_name for source in answer.type_sources],
    }
    result["fields_here"] = list(ForceEstimate.get_fields_and_field_types())

    peer.move(14.0)
    result["designed"] = design(peer, question="friction|gas_spring", seed=3)
    result["design_cancelled"] = design(peer, question="friction|gas_spring", cancel=True)
    result["design_refused"] = design(peer)
    result["identified"] = identify(peer, "sp")
    result["identify_cancelled"] = identify(peer, "fuzzy-tanh", cancel=True)
    result["identify_refused"] = identify(peer, "no-such-model")
    file = result["identified"].get("model_file")
    if file:
        loaded = peer.call(LoadModel, "load_model", LoadModel.Request(model=file))
        result["loaded"] = {"success": loaded.success, "message": loaded.message}

    # A simulation that starts in 1970, and then starts again.
    peer.set(use_sim_time=True)
    result["simulated"] = peer.move(2.5, from_ns=1_000_000_000, clock=True)
    peer.heard["diagnostics"].clear()
    result["again"] = peer.move(2.5, from_ns=1_000_000_000, clock=True)
    result["diagnostics"] = [
        {
            "stamp": to_ns(array.header.stamp) * 1e-9,
            "names": [status.name for status in array.status],
            "level": array.status[0].level[0] if array.status else None,
            "message": array.status[0].message,
            "values": {v.key: v.value for v in array.status[0].values},
        }
        for array in peer.heard["diagnostics"]
    ]
    result["silenced"] = [peer.change(Transition.TRANSITION_DEACTIVATE), peer.change(Transition.TRANSITION_INACTIVE_SHUTDOWN)]
    result["last_state"] = peer.state()
    peer.spin_for(0.5)
    result["events"] = [
        [e.start_state.label, e.transition.label, e.goal_state.label] for e in peer.heard["events"]
    ]
    result["log"] = peer.lines()
    emit(result)
    peer.executor.shutdown()
    peer.node.destroy_node()
    rclpy.shutdown()


main()
