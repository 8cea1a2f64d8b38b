#!/usr/bin/env python3
"""A node of pyzeros, an independent implementation of rmw_zenoh without ROS, behind a router like rmw_zenohd.

    rmw_peer.py ENDPOINT SECONDS        # tcp/127.0.0.1:7447 3; the domain is ROS_DOMAIN_ID

The types below are written by hand from msgs/msg, so their hashes are computed by pyzeros. The script starts the router, reads the
tokens of the damper's node, sends displacement, coil_current and measured_force, and receives every output with its attachment.
pyzeros 0.1.0 has no graph to query: tokens are fetched with plain Zenoh and compared with the tokens that pyzeros would declare.

Prints one JSON line. Numbers that must be bit-identical are given as the bits of a double.
"""

import asyncio
import json
import os
import struct
import sys
import time
from dataclasses import dataclass, field

# pyzeros compiles a codec at its first use, which takes 15 s; setup.sh has done that.
os.environ.setdefault("CYDR_CACHE_DIR", os.path.join(sys.prefix, "cydr_cache"))

import pyzeros
import zenoh
from pyzeros import node as nodes
from pyzeros import pub as pubs
from pyzeros import sub as subs
from pyzeros.builtin_msgs import Attachment
from pyzeros.qos import QosProfile, ReliabilityPolicy
from pyzeros.utils import rmw_zenoh_gid, ros_type_to_dds_type
from ros2_pyterfaces.cyclone import idl
from ros2_pyterfaces.cyclone.all_msgs import Header, JointState, Temperature, Time

from peer_common import Pace, emit, fail, percentile, samples

RATE = 512.0
PATIENCE = 30.0
NAME = "mr_damper"
OURS = "mr_damper_msgs/msg/"
float64, uint8, uint32 = idl.types.float64, idl.types.uint8, idl.types.uint32


@dataclass
class Displacement(idl.IdlStruct, typename=OURS + "Displacement"):
    header: Header = field(default_factory=Header)
    displacement: float64 = 0.0
    variance: float64 = 0.0


@dataclass
class Velocity(idl.IdlStruct, typename=OURS + "Velocity"):
    header: Header = field(default_factory=Header)
    velocity: float64 = 0.0
    variance: float64 = 0.0


@dataclass
class CoilCurrent(idl.IdlStruct, typename=OURS + "CoilCurrent"):
    header: Header = field(default_factory=Header)
    current: float64 = 0.0
    variance: float64 = 0.0


@dataclass
class CommandVoltage(idl.IdlStruct, typename=OURS + "CommandVoltage"):
    header: Header = field(default_factory=Header)
    voltage: float64 = 0.0
    variance: float64 = 0.0


@dataclass
class Force(idl.IdlStruct, typename=OURS + "Force"):
    header: Header = field(default_factory=Header)
    force: float64 = 0.0
    variance: float64 = 0.0


@dataclass
class ForceEstimate(idl.IdlStruct, typename=OURS + "ForceEstimate"):
    header: Header = field(default_factory=Header)
    force: float64 = 0.0
    std_dev: float64 = 0.0
    model: str = ""
    mode: uint8 = 0
    validity: uint8 = 0
    reasons: uint32 = 0
    input_age: float64 = 0.0
    band_low: float64 = 0.0
    band_high: float64 = 0.0
    band_calibrated: bool = False


@dataclass
class ForceResidual(idl.IdlStruct, typename=OURS + "ForceResidual"):
    header: Header = field(default_factory=Header)
    measured: float64 = 0.0
    predicted: float64 = 0.0
    residual: float64 = 0.0
    normalised: float64 = 0.0
    windowed_rsse: float64 = 0.0
    windowed_esr: float64 = 0.0
    window: float64 = 0.0
    alarm: bool = False


@dataclass
class ModeChange(idl.IdlStruct, typename=OURS + "ModeChange"):
    header: Header = field(default_factory=Header)
    from_mode: uint8 = 0
    to_mode: uint8 = 0
    reason: str = ""


@dataclass
class CurrentCommand(idl.IdlStruct, typename=OURS + "CurrentCommand"):
    header: Header = field(default_factory=Header)
    current: float64 = 0.0
    force_requested: float64 = 0.0
    force_expected: float64 = 0.0
    achievable: bool = False
    dissipative: bool = False
    limited_by: uint8 = 0
    achievable_min: float64 = 0.0
    achievable_max: float64 = 0.0


@dataclass
class OtherDisplacement(idl.IdlStruct, typename=OURS + "Displacement"):
    """The same name with another definition, and so another hash."""

    header: Header = field(default_factory=Header)
    displacement: idl.types.float32 = 0.0


OUTPUTS = {
    "force_estimate": ForceEstimate,
    "force_residual": ForceResidual,
    "mode": ModeChange,
    "current_command": CurrentCommand,
}
INPUTS = {
    "displacement": Displacement,
    "coil_current": CoilCurrent,
    "command_voltage": CommandVoltage,
    "velocity": Velocity,
    "measured_force": Force,
    "body_velocity": Velocity,
    "force_request": Force,
    "case_temperature": Temperature,
}
BEST_EFFORT = QosProfile(reliability=ReliabilityPolicy.BEST_EFFORT, depth=10)


def bits(number):
    return struct.unpack("<Q", struct.pack("<d", number))[0]


def header(ns):
    return Header(stamp=Time(sec=ns // 1_000_000_000, nanosec=ns % 1_000_000_000), frame_id="rig")


def config(settings):
    made = zenoh.Config()
    for key, value in settings.items():
        made.insert_json5(key, value)
    return made


def router(endpoint):
    """The settings of DEFAULT_RMW_ZENOH_ROUTER_CONFIG.json5 of rmw_zenoh_cpp that differ from Zenoh's defaults."""
    return config(
        {
            "mode": '"router"',
            "listen/endpoints": f'["{endpoint}"]',
            "scouting/multicast/enabled": "false",
            "scouting/gossip/target": '{router: ["router", "peer"], peer: ["router"]}',
            "routing/router/peers_failover_brokering": "false",
            "timestamping/enabled": "{router: true, peer: true, client: true}",
        }
    )


def session(endpoint):
    """The settings of DEFAULT_RMW_ZENOH_SESSION_CONFIG.json5 of rmw_zenoh_cpp that differ from Zenoh's defaults."""
    return config(
        {
            "mode": '"peer"',
            "connect/endpoints": f'["{endpoint}"]',
            "connect/retry": "{period_init_ms: 100, period_max_ms: 1000}",
            "listen/endpoints": '["tcp/localhost:0"]',
            "scouting/multicast/enabled": "false",
            "scouting/gossip/target": '{router: ["router", "peer"], peer: ["router"]}',
            "timestamping/enabled": "{router: true, peer: true, client: true}",
        }
    )


def tokens(opened, domain):
    """The tokens of the damper's node, sorted."""
    replies = opened.liveliness().get(f"@ros2_lv/{domain}/**", timeout=5.0)
    found = [str(reply.ok.key_expr) for reply in replies if reply.ok]
    return sorted(token for token in found if token.split("/")[8:9] == [NAME])


def compared(opened, found, domain):
    """Each token, and the token that pyzeros would declare for the same entity."""
    expected = []
    for token in found:
        _, _, zid, nid, eid, kind, *_ = token.split("/")
        at = dict(session=opened, domain_id=domain, namespace="/", _node_id=nid, _zenoh_id=zid, _entity_id=eid)
        if kind == "NN":
            expected.append(nodes.token_keyexpr(name=NAME, **at))
            continue
        topic = token.split("/")[9].removeprefix("%")
        of = {"MP": OUTPUTS, "MS": INPUTS}[kind].get(topic)
        if of is None:
            expected.append(f"no {kind} of {topic}")
            continue
        make, qos = (pubs, QosProfile.default()) if kind == "MP" else (subs, BEST_EFFORT)
        dds_type = ros_type_to_dds_type(of.get_type_name())
        expected.append(make.token_keyexpr(topic, dds_type, of.hash_rihs01(), qos, NAME, **at))
    return {"seen": found, "expected": expected}


class Heard:
    """The messages received on one output, with attachments decoded by pyzeros."""

    def __init__(self, of):
        self.of = of
        self.messages = []
        self.attachments = []
        self.ages = []
        self.errors = []

    def __call__(self, sample):
        try:
            told = Attachment.deserialize(b"\x00\x01\x00\x00" + sample.attachment.to_bytes())
            self.attachments.append((int(told.sequence_number), bytes(told.source_gid)))
            self.ages.append((time.time_ns() - int(told.source_timestamp)) * 1e-9)
            self.messages.append(self.of.deserialize(sample.payload.to_bytes()))
        except Exception as error:  # a callback's exception would vanish otherwise
            self.errors.append(repr(error))

    def told(self, token):
        gid = rmw_zenoh_gid(token) if token else None
        return {
            "count": len(self.messages),
            "numbers_from_1_without_gap": [a[0] for a in self.attachments] == list(range(1, len(self.messages) + 1)),
            "gid_of_the_token": all(a[1] == gid for a in self.attachments),
            "age_s": {"median": percentile(self.ages, 0.5), "p99": percentile(self.ages, 0.99)},
            "errors": self.errors[:3],
        }


async def until(what, found):
    end = time.monotonic() + PATIENCE
    while not found():
        if time.monotonic() > end:
            fail(f"waited {PATIENCE} s for {what}")
        await asyncio.sleep(0.05)


async def run(opened, endpoint, seconds, domain):
    node = pyzeros.Session(node="rig", zenoh_session=opened, namespace="/", domain_id=domain)
    await until("the damper's node, its 4 outputs and 8 inputs", lambda: len(tokens(opened, domain)) >= 13)
    seen = compared(opened, tokens(opened, domain), domain)

    heard = {topic: Heard(of) for topic, of in OUTPUTS.items()}
    for topic, taken in heard.items():
        pyzeros.sub.RawSub(OUTPUTS[topic], topic, taken, session=node)
    displacement, current, force, request = (
        pyzeros.Pub(INPUTS[topic], topic, session=node)
        for topic in ("displacement", "coil_current", "measured_force", "force_request")
    )
    other = pyzeros.Pub(OtherDisplacement, "displacement", session=node)
    # Subscriptions are declared through the router, and nothing reports when they have arrived.
    await asyncio.sleep(1.0)

    other.publish(OtherDisplacement(header=header(time.time_ns()), displacement=1.0))
    sent, pace = [], Pace(RATE)
    for x, i, f in samples(None, RATE, seconds):
        ns = pace.stamp_ns()
        if len(sent) == 100:
            request.publish(Force(header=header(ns), force=300.0))
        current.publish(CoilCurrent(header=header(ns), current=i))
        force.publish(Force(header=header(ns), force=f))
        displacement.publish(Displacement(header=header(ns), displacement=x))
        sent.append([ns, bits(x), bits(i), bits(f)])
        pace.advance()
        await asyncio.sleep(max(0.0, pace.remaining()))
    await until("as many estimates", lambda: len(heard["force_estimate"].messages) >= len(sent))
    await asyncio.sleep(0.2)

    def token(topic):
        return next((t for t in seen["seen"] if f"/MP/%/%/{NAME}/%{topic}/" in t), None)

    stamp = lambda m: m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec
    answers = [json.loads(r.ok.payload.to_bytes()) for r in opened.get(f"mr_damper/{NAME}/status") if r.ok]
    emit(
        {
            "tokens": seen,
            "outputs": {topic: taken.told(token(topic)) for topic, taken in heard.items()},
            "sent": sent,
            "estimates": [
                [stamp(m), bits(m.force), bits(m.std_dev), bits(m.band_low), bits(m.band_high), m.mode, m.validity, m.reasons]
                for m in heard["force_estimate"].messages
            ],
            "models": sorted({m.model for m in heard["force_estimate"].messages}),
            "status": answers[0]["rmw"] if answers else None,
            "other_hash": OtherDisplacement.hash_rihs01(),
            "latest_sent_s": pace.latest,
        }
    )
    node.close()


def main():
    if len(sys.argv) != 3:
        fail("usage: rmw_peer.py ENDPOINT SECONDS")
    endpoint, domain = sys.argv[1], int(os.environ.get("ROS_DOMAIN_ID", "0"))
    with zenoh.open(router(endpoint)), zenoh.open(session(endpoint)) as opened:
        asyncio.run(run(opened, endpoint, float(sys.argv[2]), domain))


if __name__ == "__main__":
    main()
