#!/usr/bin/env python3
"""Reads the Zenoh mirror of a damper without our code, and reports what it received.

    pip install eclipse-zenoh cbor2
    zenoh_reader.py ENDPOINT DAMPER SECONDS        # tcp/127.0.0.1:7447 front_left 3

Prints one JSON object on stdout. Exit code 1 if no sample arrived, 2 on wrong usage.
"""

import argparse
import json
import struct
import sys
import threading
import time

import cbor2
import zenoh

# Attachment of a CDR message: seq, stamp_ns, index in VALIDITIES.
ATTACHMENT = struct.Struct("<qqB")
VALIDITIES = ["VALID", "DEGRADED", "EXTRAPOLATING", "STALE", "INVALID"]


def first_double(cdr: bytes) -> float:
    """The first float64 after the std_msgs/Header of a little-endian CDR message."""
    assert cdr[:2] == b"\x00\x01", "not little endian CDR"
    body = cdr[4:]
    (length,) = struct.unpack_from("<I", body, 8)
    offset = (12 + length + 7) // 8 * 8
    return struct.unpack_from("<d", body, offset)[0]


def decode(sample: zenoh.Sample) -> dict:
    """The payload as a dict, by its encoding."""
    encoding = str(sample.encoding)
    data = sample.payload.to_bytes()
    if encoding == "application/json":
        return json.loads(data)
    if encoding == "application/cbor":
        return cbor2.loads(data)
    if encoding == "application/cdr":
        seq, stamp_ns, validity = ATTACHMENT.unpack(sample.attachment.to_bytes())
        value = None if str(sample.key_expr).endswith("/mode") else first_double(data)
        return {"seq": seq, "stamp_ns": stamp_ns, "validity": VALIDITIES[validity], "value": value}
    raise ValueError(f"{sample.key_expr}: unexpected encoding {encoding}")


class Route:
    """Samples received on one key."""

    def __init__(self) -> None:
        self.count = 0
        self.missing = 0
        self.encodings: set[str] = set()
        self.first = None
        self.last = None
        self.times: list[float] = []

    def add(self, sample: zenoh.Sample, now: float) -> None:
        value = decode(sample)
        if self.last is not None:
            self.missing += value["seq"] - self.last["seq"] - 1
        self.first = self.first or value
        self.last = value
        self.count += 1
        self.encodings.add(str(sample.encoding))
        self.times.append(now)

    def summary(self) -> dict:
        span = self.times[-1] - self.times[0]
        return {
            "count": self.count,
            "missing": self.missing,
            "encodings": sorted(self.encodings),
            "rate_hz": round((self.count - 1) / span, 2) if span > 0 else None,
            "first": self.first,
            "last": self.last,
        }


def ask(session: zenoh.Session, selector: str) -> dict | None:
    """The JSON answer of a queryable; None without an answer."""
    for reply in session.get(selector, timeout=5.0):
        if reply.ok:
            return json.loads(reply.ok.payload.to_bytes())
        return {"error": reply.err.payload.to_bytes().decode()}
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("endpoint")
    parser.add_argument("damper")
    parser.add_argument("seconds", type=float)
    args = parser.parse_args()

    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("connect/endpoints", json.dumps([args.endpoint]))
    config.insert_json5("connect/retry", "{period_init_ms: 100, period_max_ms: 1000}")
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")

    lock = threading.Lock()
    routes: dict[str, Route] = {}
    liveliness: list[str] = []
    errors: list[str] = []
    root = f"mr_damper/{args.damper}"

    def on_sample(sample: zenoh.Sample) -> None:
        with lock:
            try:
                key = str(sample.key_expr)[len(root) + 1 :]
                routes.setdefault(key, Route()).add(sample, time.monotonic())
            except Exception as error:  # a callback's exception would vanish otherwise
                errors.append(repr(error))

    def on_token(sample: zenoh.Sample) -> None:
        with lock:
            liveliness.append("PUT" if sample.kind == zenoh.SampleKind.PUT else "DELETE")

    with zenoh.open(config) as session:
        session.declare_subscriber(f"{root}/state/*", on_sample)
        session.declare_subscriber(f"{root}/web/*", on_sample)
        session.liveliness().declare_subscriber(f"{root}/alive", on_token, history=True)
        # Waits half of the time before the queries, so that there is history to query.
        time.sleep(args.seconds / 2)
        with lock:
            present = "PUT" in liveliness
        answers = {}
        if present:
            meta = ask(session, f"{root}/meta")
            history = ask(session, f"{root}/history?_time=[now(-1s)..];max=5") or {}
            status = ask(session, f"{root}/status")
            answers = {
                "meta": meta and {key: meta.get(key) for key in ("schema", "version", "models", "modes")},
                "history": {key: len(history.get(key, [])) for key in ("force_estimate", "force_residual")},
                "status": status and {key: status.get(key) for key in ("state", "events", "ring_dropped")},
            }
        time.sleep(args.seconds / 2)

    with lock:
        summary = {
            "routes": {key: route.summary() for key, route in sorted(routes.items())},
            "missing": sum(route.missing for route in routes.values()),
            "liveliness": liveliness,
            "answers": answers,
            "errors": errors[:5],
        }
    print(json.dumps(summary))
    return 0 if summary["routes"] and not errors else 1


if __name__ == "__main__":
    sys.exit(main())
