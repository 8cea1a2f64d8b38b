#!/usr/bin/env python3
"""A peer on another vendor's DDS: CycloneDDS, without ROS.

The types below are written by hand from msgs/msg and not generated, so that a mistake in our definitions is not repeated here.
Sends displacement, coil_current and measured_force like a ROS 2 node, receives force_estimate, force_residual and mode, and collects
the type names that the other side announces. Prints one JSON line.
"""

import argparse
import os
import sys
import time
from dataclasses import dataclass

# Only loopback, with multicast on it: the namespaces of the tests have nothing else.
INTERFACE = sys.argv[sys.argv.index("--interface") + 1] if "--interface" in sys.argv else "lo"
os.environ.setdefault(
    "CYCLONEDDS_URI",
    "<CycloneDDS><Domain><General><Interfaces>"
    f"<NetworkInterface name='{INTERFACE}' multicast='true'/></Interfaces></General></Domain></CycloneDDS>",
)

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

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

OURS = "mr_damper_msgs::msg::dds_::"


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Displacement(IdlStruct, typename=OURS + "Displacement_"):
    header: Header
    displacement: float64
    variance: float64


@dataclass
class CoilCurrent(IdlStruct, typename=OURS + "CoilCurrent_"):
    header: Header
    current: float64
    variance: float64


@dataclass
class Force(IdlStruct, typename=OURS + "Force_"):
    header: Header
    force: float64
    variance: float64


@dataclass
class ForceEstimate(IdlStruct, typename=OURS + "ForceEstimate_"):
    header: Header
    force: float64
    std_dev: float64
    model: str
    mode: uint8
    validity: uint8
    reasons: uint32
    input_age: float64
    band_low: float64
    band_high: float64
    band_calibrated: bool


@dataclass
class ForceResidual(IdlStruct, typename=OURS + "ForceResidual_"):
    header: Header
    measured: float64
    predicted: float64
    residual: float64
    normalised: float64
    windowed_rsse: float64
    windowed_esr: float64
    window: float64
    alarm: bool


@dataclass
class ModeChange(IdlStruct, typename=OURS + "ModeChange_"):
    header: Header
    from_mode: uint8
    to_mode: uint8
    reason: str


TYPES = {
    "displacement": Displacement,
    "coil_current": CoilCurrent,
    "measured_force": Force,
    "force_estimate": ForceEstimate,
    "force_residual": ForceResidual,
    "mode": ModeChange,
}
QOS = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(1000),
    Policy.DataRepresentation(use_cdrv0_representation=True),  # plain CDR, as in ROS 2
)


def to_ns(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


class Peer:
    def __init__(self, namespace, outputs, inputs):
        self.inputs, self.outputs = inputs, outputs
        self.participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))

        def topic(name):
            return Topic(self.participant, f"rt{namespace}/{name}", TYPES[name], qos=QOS)

        self.writers = {name: DataWriter(self.participant, topic(name), qos=QOS) for name in inputs}
        self.readers = {name: DataReader(self.participant, topic(name), qos=QOS) for name in outputs}
        self.received = {name: [] for name in outputs}
        self.sent = {name: [] for name in inputs}
        self.counted_from = 0
        self.announced = {}
        self.builtin = [
            BuiltinDataReader(self.participant, BuiltinTopicDcpsPublication),
            BuiltinDataReader(self.participant, BuiltinTopicDcpsSubscription),
        ]

    def take(self):
        for name, reader in self.readers.items():
            self.received[name].extend(reader.take(N=1000))

    def publish(self, name, ns, value):
        header = Header(stamp=Time(sec=ns // 1_000_000_000, nanosec=ns % 1_000_000_000), frame_id="")
        self.writers[name].write(TYPES[name](header, value, 0.0))

    def look_around(self):
        """Collects the type names that other participants announce for our topics."""
        own = self.participant.guid
        for reader in self.builtin:
            for entity in reader.take(N=1000):
                # an entity that has gone is reported with its `key` only
                if getattr(entity, "type_name", None) and entity.participant_key != own:
                    self.announced[entity.topic_name] = entity.type_name

    def matched(self):
        return all(w.get_matched_subscriptions() for w in self.writers.values()) and all(
            r.get_matched_publications() for r in self.readers.values()
        )

    def connect(self):
        deadline = time.monotonic() + 15.0
        while not self.matched():
            self.look_around()
            if time.monotonic() > deadline:
                fail(
                    f"after 15 s the topics {', '.join(self.inputs + self.outputs)} are not all matched "
                    f"(announced by others: {self.announced}); is the node running, in this ROS_DOMAIN_ID?"
                )
            time.sleep(0.02)
        # A volatile writer of the node may not know our reader yet: send until the first answer
        # arrives.
        for _ in range(200):
            ns = time.time_ns()
            for name in ("coil_current", "displacement"):
                if name in self.inputs:
                    self.publish(name, ns, 0.0)
            time.sleep(0.05)
            self.take()
            if self.received["force_estimate"]:
                break
        else:
            fail("no force_estimate came back for 200 displacements in 10 s")
        time.sleep(0.3)
        self.take()
        for messages in self.received.values():
            messages.clear()

    def send(self, path, rate, seconds):
        pace = Pace(rate)
        self.counted_from = pace.first_ns + round(WARM_UP * 1e9)
        for displacement, current, force in samples(path, rate, WARM_UP + seconds):
            while (remaining := pace.remaining()) > 0:
                self.take()
                time.sleep(min(remaining, 0.001))
            ns = pace.stamp_ns()
            figures = {"coil_current": current, "measured_force": force, "displacement": displacement}
            for name, value in figures.items():
                if name in self.inputs:
                    self.publish(name, ns, value)
                    if ns >= self.counted_from:
                        self.sent[name].append(ns)
            pace.advance()
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            self.take()
            time.sleep(0.01)
        self.look_around()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--interface", default="lo", help="network interface, read before CycloneDDS starts")
    parser.add_argument("--namespace", default="", help="namespace of the node, such as /front_left")
    parser.add_argument("--against", choices=["node", "echo"], default="node")
    parser.add_argument("--csv", help="run to send; default: a sine")
    parser.add_argument("--rate", type=float, default=512.0, help="samples per second")
    parser.add_argument("--seconds", type=float, default=6.0)
    args = parser.parse_args()

    node = args.against == "node"
    peer = Peer(args.namespace, OUTPUTS if node else OUTPUTS[:1], INPUTS if node else INPUTS[:1])
    peer.connect()
    peer.send(args.csv, args.rate, args.seconds)

    counted = {name: since(peer.counted_from, peer.received[name], to_ns) for name in peer.outputs}
    result = {
        "peer": "cyclonedds",
        "sent": {name: len(stamps) for name, stamps in peer.sent.items()},
        "announced": {t.removeprefix("rt"): n for t, n in peer.announced.items() if t.startswith("rt/")},
        "force_estimate": answers(peer.sent["displacement"], counted["force_estimate"], to_ns),
    }
    if node:
        result["force_residual"] = residuals(peer.sent["measured_force"], counted["force_residual"], to_ns)
        result["mode"] = mode_changes(peer.received["mode"])
    emit(result)


main()
