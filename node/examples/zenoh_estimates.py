#!/usr/bin/env python3
"""Prints what every damper's force is, heard by Zenoh, with nothing of ours: zenoh_estimates.py tcp/127.0.0.1:7447 [COUNT]"""

import itertools
import json
import signal
import sys

import zenoh  # pip install eclipse-zenoh

endpoint, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("connect/timeout_ms", "-1")  # wait for who is not there yet
signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends the wait, too
with zenoh.open(config) as session:
    estimates = session.declare_subscriber("mr_damper/**/web/force_estimate")
    for sample in itertools.islice(estimates, count):
        said = json.loads(sample.payload.to_bytes())
        print(sample.key_expr, said["force_n"], "N", said["validity"], flush=True)
