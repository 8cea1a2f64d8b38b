#!/usr/bin/env python3
"""A simulated cable between two held network namespaces (netns.sh), with seeded loss, delay, reordering, duplication and cuts.

usage: bad_wire.py PID PID [--seed N]          root only

Each namespace gets a TAP device (`near` 10.77.0.1, `far` 10.77.0.2, with the multicast route), and this program carries Ethernet
frames between the two. Faults apply only to IPv4/UDP, including fragments of datagrams: ARP always gets through, because one lost
reply would act like a cut of a second. Commands are JSON lines on standard input; each replaces all current faults:

    {"name": "rain", "loss": 0.2, "delay_ms": 5, "jitter_ms": 8, "duplicate": 0.1, "burst_every_s": 0.5, "burst_ms": 80, "cut": false,
     "keep_writers_in_order": false}

    loss, duplicate    probability for each frame, independently
    delay_ms           delay of every frame; jitter_ms: largest additional delay, drawn for each frame, so that frames overtake each other
    burst_every_s      mean time between bursts; in each burst all frames are lost for burst_ms
    cut                all frames are lost
    keep_writers_in_order   frames with samples of one DDS writer never overtake each other, only frames of other writers: jitter alone
                       reorders a topic as well if its sender, or this program, was delayed and two samples follow each other closely

Each command is answered with a line {"event": "set", "name": ...}. When standard input closes, one line reports the numbers of
frames carried, lost, repeated and overtaken, by name.
"""

import argparse
import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import struct
import subprocess
import sys
import time

CLONE_NEWNET = 0x40000000
TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
FRAME = 65_536
CLEAN = {
    "name": "clean",
    "loss": 0.0,
    "delay_ms": 0.0,
    "jitter_ms": 0.0,
    "duplicate": 0.0,
    "burst_every_s": 0.0,
    "burst_ms": 0.0,
    "cut": False,
    "keep_writers_in_order": False,
}
# Identifier of the RTPS submessage that carries a sample.
DATA = 0x15


def fail(message):
    print(f"bad_wire.py: {message}", file=sys.stderr, flush=True)
    sys.exit(1)


def enter(path):
    """Moves this thread, and the programs it starts, into a network namespace."""
    libc = ctypes.CDLL(None, use_errno=True)
    with open(path, "rb") as space:
        if libc.setns(space.fileno(), CLONE_NEWNET) != 0:
            fail(f"{path}: {os.strerror(ctypes.get_errno())}; run this as root")


def writer_of(frame):
    """The DDS writer of the first sample in an unfragmented UDP frame, as bytes, or `None` if it carries none."""
    datagram = frame[14 + 4 * (frame[14] & 0xF) + 8 :]
    if datagram[:4] != b"RTPS":
        return None
    participant, at = datagram[8:20], 20
    while at + 4 <= len(datagram):
        kind, flags = datagram[at], datagram[at + 1]
        length = int.from_bytes(datagram[at + 2 : at + 4], "little" if flags & 1 else "big")
        if kind == DATA:
            # Behind the header: two bytes of flags, two of an offset, and the reader's identifier.
            return participant + datagram[at + 12 : at + 16]
        if length == 0:
            return None
        at += 4 + length
    return None


def tap(pid, name, address):
    """Opens the device in the namespace that `pid` holds. It stays open when this thread enters another namespace."""
    enter(f"/proc/{pid}/ns/net")
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
    for command in (
        ["ip", "addr", "add", f"{address}/24", "dev", name],
        ["ip", "link", "set", name, "up"],
        ["ip", "route", "replace", "224.0.0.0/4", "dev", name],
    ):
        subprocess.run(command, check=True)
    return device


class Wire:
    """The current faults, the frames on their way, and the counts."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.set = dict(CLEAN)
        self.on_the_way = []
        self.number = 0
        self.latest = {}
        self.latest_of_writer = {}
        self.burst_until = 0.0
        self.next_burst = float("inf")
        self.done = {}

    def obey(self, command, now):
        unknown = set(command) - set(CLEAN)
        if unknown:
            fail(f"unknown {sorted(unknown)} in {command}; use {sorted(CLEAN)}")
        self.set = {**CLEAN, **command}
        self.burst_until = 0.0
        self.next_burst = now + self.until_burst()

    def until_burst(self):
        every = self.set["burst_every_s"]
        return self.random.expovariate(1.0 / every) if every > 0 else float("inf")

    def is_lost(self, now):
        if now >= self.next_burst:
            self.burst_until = now + self.set["burst_ms"] * 1e-3
            self.next_burst = self.burst_until + self.until_burst()
        return self.set["cut"] or now < self.burst_until or self.random.random() < self.set["loss"]

    def take(self, frame, to, now):
        """Takes a frame from one end."""
        counts = self.done.setdefault(
            self.set["name"], {"carried": 0, "lost": 0, "repeated": 0, "overtaken": 0}
        )
        if not (frame[12:14] == b"\x08\x00" and frame[23] == 17):
            self.send_later(frame, to, now, counts)
            return
        if self.is_lost(now):
            counts["lost"] += 1
            return
        copies = 1
        if self.random.random() < self.set["duplicate"]:
            counts["repeated"] += 1
            copies = 2
        for _ in range(copies):
            delay_ms = self.set["delay_ms"] + self.random.uniform(0.0, self.set["jitter_ms"])
            due = now + delay_ms * 1e-3
            writer = writer_of(frame) if self.set["keep_writers_in_order"] else None
            if writer is not None:
                # Frames that are due at one time leave in the order in which they came.
                due = self.latest_of_writer[writer] = max(due, self.latest_of_writer.get(writer, 0.0))
            self.send_later(frame, to, due, counts)

    def send_later(self, frame, to, due, counts):
        counts["carried"] += 1
        counts["overtaken"] += due < self.latest.get(to, 0.0)
        self.latest[to] = max(due, self.latest.get(to, 0.0))
        self.number += 1
        heapq.heappush(self.on_the_way, (due, self.number, to, frame))

    def deliver(self, now):
        while self.on_the_way and self.on_the_way[0][0] <= now:
            _, _, to, frame = heapq.heappop(self.on_the_way)
            try:
                os.write(to, frame)
            except OSError as error:
                fail(f"cannot send a frame of {len(frame)} bytes: {error}")

    def wait(self, now):
        return max(0.0, self.on_the_way[0][0] - now) if self.on_the_way else None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pids", type=int, nargs=2)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    try:
        near = tap(args.pids[0], "near", "10.77.0.1")
        far = tap(args.pids[1], "far", "10.77.0.2")
    except OSError as error:
        # Reported differently from a fault of this program, so that the test can be skipped.
        print(json.dumps({"event": "absent", "why": str(error)}), flush=True)
        return
    print(json.dumps({"event": "up"}), flush=True)
    wire = Wire(args.seed)
    ends = {near: far, far: near}
    unread = b""
    while True:
        ready, _, _ = select.select([near, far, 0], [], [], wire.wait(time.monotonic()))
        now = time.monotonic()
        for end in ready:
            if end == 0:
                read = os.read(0, FRAME)
                if not read:
                    print(json.dumps(wire.done), flush=True)
                    return
                unread += read
                *lines, unread = unread.split(b"\n")
                for line in lines:
                    wire.obey(json.loads(line), now)
                    print(json.dumps({"event": "set", "name": wire.set["name"]}), flush=True)
                continue
            while True:
                try:
                    wire.take(os.read(end, FRAME), ends[end], now)
                except BlockingIOError:
                    break
        wire.deliver(time.monotonic())


main()
