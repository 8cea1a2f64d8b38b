#!/usr/bin/env python3
"""Commands a damper by Zenoh without our code, as a Zenoh user, and tries commands that must be refused.

    pip install eclipse-zenoh
    zenoh_supervisor.py ENDPOINT DAMPER USER PASSWORD

Prints one JSON object on stdout: the answer to each command.
"""

import json
import sys
import time

import zenoh


def session(endpoint: str, user: str, password: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/auth/usrpwd", json.dumps({"user": user, "password": password}))
    return zenoh.open(config)


def command(**fields) -> str:
    now = time.time_ns()
    return json.dumps({"seq": now, "deadline_ns": now + 2_000_000_000, **fields})


def told(opened: zenoh.Session, key: str, payload: str | None = None) -> dict | None:
    """The answer to a command or query; None without an answer."""
    for reply in opened.get(key, payload=payload, timeout=2.0):
        return json.loads((reply.ok or reply.err).payload.to_bytes())
    return None


def main() -> int:
    if len(sys.argv) != 5:
        print(__doc__, file=sys.stderr)
        return 2
    endpoint, damper, user, password = sys.argv[1:]
    root = f"mr_damper/{damper}"
    saw = {}
    with session(endpoint, user, password) as opened:
        end = time.monotonic() + 20
        # The command keys are the last ones that a node declares: before that, no command is
        # answered.
        saw["set_mode"] = None
        while saw["set_mode"] is None and time.monotonic() < end:
            time.sleep(0.1)
            again = command(mode="model")
            saw["set_mode"] = told(opened, f"{root}/cmd/set_mode", again)
        saw["set_mode_again"] = told(opened, f"{root}/cmd/set_mode", again)
        saw["unknown_mode"] = told(opened, f"{root}/cmd/set_mode", command(mode="turbo"))
        saw["load_model"] = told(opened, f"{root}/cmd/load_model", command(model="thesis/fuzzy-tanh/rp2-cs"))
        saw["any_file"] = told(opened, f"{root}/cmd/load_model", command(model="/etc/passwd"))
        saw["force_request"] = told(opened, f"{root}/cmd/force_request", command(force_n=350.0))
        opened.put(f"{root}/cmd/force_request", command(force_n="much"))
        saw["last"] = [str(reply.ok.key_expr) for reply in opened.get(f"{root}/state/*") if reply.ok]
        time.sleep(0.3)
        saw["commands"] = (told(opened, f"{root}/status") or {}).get("commands")
    with session(endpoint, user, password + "?") as refused:
        time.sleep(1.0)
        saw["with_a_wrong_password"] = told(refused, f"{root}/status")
    print(json.dumps(saw))
    return 0


if __name__ == "__main__":
    sys.exit(main())
