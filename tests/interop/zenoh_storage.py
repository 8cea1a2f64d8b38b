#!/usr/bin/env python3
"""Receives a damper's values through a router until its vehicle is gone, then queries the router's storage for the last values.

    pip install eclipse-zenoh
    zenoh_storage.py ENDPOINT DAMPER         # tcp/127.0.0.1:7447 truck/front_left

Prints {"event": "ready"} when it is subscribed, {"event": "given up"} when the damper first reports that it has no force any more, and
at the end one JSON object: the last payload received and the payload stored for each key.
"""

import json
import sys
import threading
import time

import zenoh


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    endpoint, damper = sys.argv[1:]
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "-1")  # a router may be there later than its client
    config.insert_json5("scouting/multicast/enabled", "false")
    heard: dict[str, dict] = {}
    had_force, given_up, gone = threading.Event(), threading.Event(), threading.Event()

    def hear(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        heard[key] = json.loads(sample.payload.to_bytes())
        if key.endswith("/web/force_estimate"):
            if heard[key]["validity"] == "VALID":
                had_force.set()
            elif heard[key]["validity"] == "INVALID" and had_force.is_set():
                given_up.set()

    def live(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            gone.set()

    with zenoh.open(config) as session:
        web = session.declare_subscriber(f"mr_damper/{damper}/web/*", hear)
        alive = session.liveliness().declare_subscriber(f"mr_damper/{damper}/alive", live, history=True)
        print(json.dumps({"event": "ready"}), flush=True)
        if given_up.wait(60):
            print(json.dumps({"event": "given up"}), flush=True)
        left = gone.wait(60)
        time.sleep(0.5)  # values on their way to the storage arrive
        replies = session.get("mr_damper/**/web/*", timeout=3.0)
        stored = {str(reply.ok.key_expr): json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok}
        alive.undeclare()
        web.undeclare()
    print(json.dumps({"gone": left, "heard": heard, "stored": stored}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
