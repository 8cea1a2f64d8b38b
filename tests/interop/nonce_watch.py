#!/usr/bin/env python3
"""Watches the initialization vectors of DDS-Security on the loopback interface, until standard input closes.

usage: nonce_watch.py

AES-GCM must never use one vector twice with one key. The session keys are derived from keys that this program does not have, so it
looks at session and vector of all senders: two messages with different content that share both are counted as `reused`. Prints
{"event": "ready"}, and at the end a line of JSON: `reused`, and for each sender (GUID prefix) the number of protected `messages`
(whole messages and submessages), the `sessions`, and the `span` from the lowest to the highest vector. Vectors inside encrypted
submessages are not visible. Needs CAP_NET_RAW, which root has in its own network namespace.
"""

import hashlib
import json
import select
import socket
import struct
import sys

SEC_PREFIX, SEC_POSTFIX, SRTPS_PREFIX = 0x31, 0x32, 0x33
RTPS_HEADER, SUBMESSAGE_HEADER = 20, 4
ETH_P_IP = 0x0800
ETHERNET, UDP = 14, 8


class Watch:
    def __init__(self):
        self.contents, self.senders, self.reused = {}, {}, 0

    def datagram(self, data):
        if data[:4] != b"RTPS" or len(data) < RTPS_HEADER:
            return
        sender = data[8:20].hex()
        prefix = None
        for kind, start, end in submessages(data):
            if kind == SRTPS_PREFIX:
                self.protected(sender, data[start:end], data[end:])
            elif kind == SEC_PREFIX:
                prefix = (start, end)
            elif kind == SEC_POSTFIX and prefix:
                self.protected(sender, data[slice(*prefix)], data[prefix[1] : end])
                prefix = None

    def protected(self, sender, header, content):
        """A crypto header has kind, key, session (4 bytes each) and vector (8 bytes)."""
        session, vector = header[8:12].hex(), struct.unpack(">Q", header[12:20])[0]
        digest = hashlib.sha256(content).digest()
        known = self.contents.setdefault((session, vector), digest)
        if known is not digest:
            self.reused += known != digest
            return
        seen = self.senders.setdefault(sender, {"messages": 0, "sessions": set(), "vectors": []})
        seen["messages"] += 1
        seen["sessions"].add(session)
        seen["vectors"].append(vector)

    def summary(self):
        senders = {
            sender: {
                "messages": seen["messages"],
                "sessions": sorted(seen["sessions"]),
                "span": max(seen["vectors"]) - min(seen["vectors"]),
            }
            for sender, seen in self.senders.items()
        }
        return {"reused": self.reused, "senders": senders}


def submessages(data):
    """Kind, first byte after the header and end of each submessage."""
    at = RTPS_HEADER
    while at + SUBMESSAGE_HEADER <= len(data):
        kind, flags = data[at], data[at + 1]
        (length,) = struct.unpack_from("<H" if flags & 1 else ">H", data, at + 2)
        start = at + SUBMESSAGE_HEADER
        at = start + length if length else len(data)
        if at > len(data):
            return
        yield kind, start, at


def udp_payload(frame):
    """The payload of a UDP datagram over IPv4; empty for other frames."""
    packet = frame[ETHERNET:]
    if len(packet) < 20 or packet[0] >> 4 != 4 or packet[9] != socket.IPPROTO_UDP:
        return b""
    return packet[(packet[0] & 0xF) * 4 + UDP :]


def main():
    watch = Watch()
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_IP)) as link:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        link.bind(("lo", 0))
        print(json.dumps({"event": "ready"}), flush=True)
        while True:
            ready, _, _ = select.select([link, sys.stdin], [], [])
            if link in ready:
                # A socket of one protocol gets only incoming packets, so each packet of the loopback interface
                # once.
                watch.datagram(udp_payload(link.recv(1 << 17)))
            elif not sys.stdin.readline():
                break
    print(json.dumps(watch.summary()), flush=True)


if __name__ == "__main__":
    main()
