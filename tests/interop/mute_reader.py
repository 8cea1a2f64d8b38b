#!/usr/bin/env python3
"""A reliable reader that never acknowledges but keeps renewing its lease. Root only: it captures one real announcement.

It announces a participant and a reader of each topic on the command line (topic=type, with DDS names) to the first participants on
this host, and then sends only signs of life. Prints {"event": "ready"}; ends when standard input closes.
"""

import os
import select
import socket
import struct
import sys
import time

from bad_rtps import DATA, INFO_DST, SPDP_WRITER, captured, header, sequence, submessage, submessages
from peer_common import emit, fail

STRANGER = bytes.fromhex("01124d555445000000000001")
SUBSCRIPTIONS_WRITER, SUBSCRIPTIONS_READER = bytes.fromhex("000004c2"), bytes.fromhex("000004c7")
PERIOD = 1.0
# A RustDDS participant announces itself about every ten seconds.
PATIENCE = 60.0
# The node is one of the first participants.
PARTICIPANTS = 4


def parameter(pid, value):
    value += bytes(-len(value) % 4)
    return struct.pack("<HH", pid, len(value)) + value


def text(value):
    return struct.pack("<I", len(value) + 1) + value.encode() + b"\0"


def announced_reader(number, topic, of, port):
    """The DATA submessage that announces a reliable reader of `topic`."""
    locator = struct.pack("<II", 1, port) + bytes(12) + socket.inet_aton("127.0.0.1")
    parameters = (
        parameter(0x5A, STRANGER + bytes([0, 0, number, 4]))  # endpoint GUID
        + parameter(0x05, text(topic))
        + parameter(0x07, text(of))
        + parameter(0x1A, struct.pack("<III", 2, 0, 0))  # RELIABLE
        + parameter(0x2F, locator)
        + struct.pack("<HH", 1, 0)
    )
    body = struct.pack("<HH", 0, 16) + SUBSCRIPTIONS_READER + SUBSCRIPTIONS_WRITER + sequence(number)
    return submessage(DATA, 5, body + b"\x00\x03\x00\x00" + parameters)


def is_announcement(packet):
    """True for a participant's own announcement to everybody."""
    kinds = [(kind, body) for kind, _, body in submessages(packet)]
    to_all = all(kind != INFO_DST for kind, _ in kinds)
    return to_all and any(kind == DATA and body[8:12] == SPDP_WRITER and len(body) > 100 for kind, body in kinds)


def main():
    topics = [argument.split("=", 1) for argument in sys.argv[1:]]
    base = 7400 + 250 * int(os.environ.get("ROS_DOMAIN_ID", "0"))
    deadline = time.monotonic() + PATIENCE
    alive = next(filter(is_announcement, captured(PATIENCE)), None)
    if alive is None:
        fail(f"no participant announced itself within {PATIENCE:g} s")
    alive = alive.replace(alive[8:20], STRANGER)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to:
        to.bind(("127.0.0.1", 0))
        to.setblocking(False)
        readers = [announced_reader(k + 1, *topic, to.getsockname()[1]) for k, topic in enumerate(topics)]
        ports = [base + 10 + 2 * participant for participant in range(PARTICIPANTS)]
        for port in ports:
            to.sendto(alive, ("127.0.0.1", port))
        time.sleep(1.0)
        begin, received = time.monotonic(), 0
        ready = False
        while not select.select([sys.stdin], [], [], 0.0)[0]:
            for packet in (alive, *(header(STRANGER) + reader for reader in readers)):
                for port in ports:
                    to.sendto(packet, ("127.0.0.1", port))
            end = time.monotonic() + PERIOD
            while time.monotonic() < end:
                if select.select([to], [], [], 0.1)[0]:
                    received += len(to.recv(65_536)) > 0
            if received > 10 and not ready:
                ready = True
                emit({"event": "ready", "after_s": time.monotonic() - begin})
            if not ready and time.monotonic() > deadline:
                fail(f"the node sent nothing to the announced readers within {PATIENCE:g} s")


main()
