#!/usr/bin/env python3
"""Prints the force of every damper, received over Zenoh. Needs nothing of this project.

Usage: zenoh_estimates.py tcp/127.0.0.1:7447 [COUNT]
"""

import itertools
import json
import signal
import sys

import zenoh  # pip install eclipse-zenoh

endpoint, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("connect/timeout_ms", "-1")  # wait until the endpoint is there
signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C also ends the wait
with zenoh.open(config) as session:
    estimates = session.declare_subscriber("mr_damper/**/web/force_estimate")
    for sample in itertools.islice(estimates, count):
        said = json.loads(sample.payload.to_bytes())
        print(sample.key_expr, said["force_n"], "N", said["validity"], flush=True)
