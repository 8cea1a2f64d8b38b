#!/usr/bin/env python3
"""A reliable CycloneDDS reader of estimates and commands of several dampers, which a test kills or stops.

It never reads the content, so its types have only names. Prints {"event": "ready"}; ends when standard input closes.
"""

import os
import sys

# Only loopback, with multicast on it: the namespaces of the tests have nothing else.
os.environ.setdefault(
    "CYCLONEDDS_URI",
    "<CycloneDDS><Domain><General><Interfaces>"
    "<NetworkInterface name='lo' multicast='true'/></Interfaces></General></Domain></CycloneDDS>",
)

import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import uint8
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from peer_common import emit, fail

OURS = "mr_damper_msgs::msg::dds_::"


@dataclass
class Estimate(IdlStruct, typename=OURS + "ForceEstimate_"):
    nothing: uint8


@dataclass
class Command(IdlStruct, typename=OURS + "CurrentCommand_"):
    nothing: uint8


def main():
    dampers = int(sys.argv[1])
    participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
    qos = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10))
    readers = []
    for k in range(dampers):
        for name, of in (("force_estimate", Estimate), ("current_command", Command)):
            readers.append(DataReader(participant, Topic(participant, f"rt/d{k}/{name}", of, qos=qos), qos=qos))
    deadline = time.monotonic() + 20.0
    while not all(reader.get_matched_publications() for reader in readers):
        if time.monotonic() > deadline:
            fail("not every topic was matched within 20 s; is the node running, in this ROS_DOMAIN_ID?")
        time.sleep(0.05)
    emit({"event": "ready"})
    sys.stdin.read()


main()
