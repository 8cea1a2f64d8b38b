"""What the Python peers share: one result line, stamps, a synthetic run, and pacing."""

import csv
import json
import math
import sys
import time

MODES = ["arx", "arx_coast", "model", "hold", "fault"]
INPUTS = ("displacement", "coil_current", "measured_force")
OUTPUTS = ("force_estimate", "force_residual", "mode")
WARM_UP = 0.5  # seconds of every run that are sent and not counted: the node's inputs arrive in any order at first


def emit(result):
    """Prints one JSON line; what is not finite becomes null."""
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
    """Ends the peer with a message that says what, where and what to do."""
    print(f"{sys.argv[0]}: {message}", file=sys.stderr, flush=True)
    sys.exit(1)


def samples(path, rate, seconds):
    """Yields (displacement in m, current in A, force in N): rows of a run, or a sine with a steplike current.

    The synthetic force is no damper's; it only has the size and sign of one.
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
    """Due times on a fixed grid: a late sample does not shift those after it.

    Stamps lie on the grid too, as those of a sampling card do: they tell when a sample was due, not when Python
    got round to it.
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
        """Seconds until the next sample is due; zero or negative: now."""
        return self.next - time.perf_counter()

    def advance(self):
        """Marks the next sample as sent."""
        self.latest = max(self.latest, -self.remaining())
        self.next += self.period
        self.count += 1


def answers(sent, messages, to_ns):
    """Whether each displacement got exactly one estimate, with its stamp; and what the estimates say.

    When displacement falls silent the node holds its last estimate and then gives none: those carry the last
    stamp again, are told by their mode, and are counted apart.
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
    """Whether each measured force got its residual, and whether that is what it says."""
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
    """The messages whose stamp is not before `ns`."""
    return [m for m in messages if to_ns(m.header.stamp) >= ns]


def mode_changes(messages):
    return [{"from": MODES[m.from_mode], "to": MODES[m.to_mode], "reason": m.reason} for m in messages]


def percentile(values, share):
    """The nearest-rank percentile of unsorted values; NaN when there are none."""
    if not values:
        return math.nan
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
