"""Shared by the Python peers: the result line, stamps, a synthetic run, and pacing."""

import csv
import json
import math
import sys
import time

MODES = ["arx", "arx_coast", "model", "hold", "fault"]
INPUTS = ("displacement", "coil_current", "measured_force")
OUTPUTS = ("force_estimate", "force_residual", "mode")
WARM_UP = 0.5  # seconds at the start of every run that are not counted: the node's inputs arrive in any order at first


def emit(result):
    """Prints one JSON line; numbers that are not finite become null."""
    print(json.dumps(_finite(result), allow_nan=False), flush=True)


def _finite(value):
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value


def fail(message):
    """Ends the peer with a message that says what failed, where and what to do."""
    print(f"{sys.argv[0]}: {message}", file=sys.stderr, flush=True)
    sys.exit(1)


def samples(path, rate, seconds):
    """Yields (displacement in m, current in A, force in N): rows of a run, or a sine with a stepped current.

    The synthetic force is not from a damper; it only has a damper's magnitude and sign.
    """
    count = int(rate * seconds)
    if path:
        with open(path, newline="", encoding="utf-8") as file:
            rows = csv.DictReader(file)
            for row, _ in zip(rows, range(count)):
                yield (
                    float(row["displacement_m"]),
                    float(row.get("current_a") or 0.0),
                    float(row.get("force_n") or 0.0),
                )
        return
    omega = 2.0 * math.pi * 2.0
    for k in range(count):
        t = k / rate
        velocity = 0.008 * omega * math.cos(omega * t)
        current = 0.4 if (t % 2.0) < 1.0 else 0.8
        yield 0.008 * math.sin(omega * t), current, (300.0 + 400.0 * current) * math.tanh(20.0 * velocity)


class Pace:
    """Due times on a fixed grid: a late sample does not shift later samples.

    Stamps are on the grid too, as from a sampling card: they are the times at which samples were due, not the times at which Python
    sent them.
    """

    def __init__(self, rate):
        self.period = 1.0 / rate
        self.first_ns = time.time_ns()
        self.count = 0
        self.next = time.perf_counter()
        self.latest = 0.0

    def stamp_ns(self):
        """The stamp of the next sample."""
        return self.first_ns + round(self.count * self.period * 1e9)

    def remaining(self):
        """Seconds until the next sample is due; zero or negative if it is due now."""
        return self.next - time.perf_counter()

    def advance(self):
        """Marks the next sample as sent."""
        self.latest = max(self.latest, -self.remaining())
        self.next += self.period
        self.count += 1


def answers(sent, messages, to_ns):
    """Checks that each displacement got exactly one estimate with its stamp, and summarises the estimates.

    When displacement stops, the node holds its last estimate and then reports that it has none. These estimates repeat the last stamp;
    they are recognised by their mode and counted separately.
    """
    silent = (MODES.index("hold"), MODES.index("fault"))
    live = [m for m in messages if m.mode not in silent]
    stamps = [to_ns(m.header.stamp) for m in live]
    forces = [m.force for m in live if math.isfinite(m.force)]
    return {
        "count": len(live),
        "while_silent": len(messages) - len(live),
        "lost": len(set(sent) - set(stamps)),
        "unknown_stamps": len(set(stamps) - set(sent)),
        "repeated": len(stamps) - len(set(stamps)),
        "in_order": all(a < b for a, b in zip(stamps, stamps[1:])),
        "finite": len(forces),
        "largest_force": max(map(abs, forces), default=0.0),
        "models": sorted({m.model for m in live}),
        "modes": {name: sum(m.mode == k for m in messages) for k, name in enumerate(MODES)},
        "validities": {str(v): sum(m.validity == v for m in live) for v in range(5)},
    }


def residuals(sent, messages, to_ns):
    """Checks that each measured force got its residual, and that residuals are measured minus predicted."""
    stamps = {to_ns(m.header.stamp) for m in messages}
    return {
        "count": len(messages),
        "lost": len(set(sent) - stamps),
        "first_lost": next((k for k, ns in enumerate(sent) if ns not in stamps), None),
        "unknown_stamps": len(stamps - set(sent)),
        "consistent": all(m.residual == m.measured - m.predicted for m in messages),
        "last_windowed_esr": messages[-1].windowed_esr if messages else math.nan,
    }


def since(ns, messages, to_ns):
    """The messages with stamps at or after `ns`."""
    return [m for m in messages if to_ns(m.header.stamp) >= ns]


def mode_changes(messages):
    return [{"from": MODES[m.from_mode], "to": MODES[m.to_mode], "reason": m.reason} for m in messages]


def percentile(values, share):
    """The nearest-rank percentile of unsorted values; NaN without values."""
    if not values:
        return math.nan
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
