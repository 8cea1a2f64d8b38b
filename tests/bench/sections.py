"""The measurements, one function each: the first line of its docstring says what it measures, and its result is stored as JSON."""

import os
import re
import shutil
import tempfile
from pathlib import Path

from common import BINARY, FOLDER, INTEROP, TARGET, Missing, build, last_json, middle, need, run, say, used

MODEL = "thesis/fuzzy-tanh/rp3-cs"
# Effects by id; the first one is the effect of the rig.
CANDIDATES = ["coil_lag", "friction", "gas_spring", "inertia", "asymmetry", "sensor_delay", "remanence", "load_cell_drift"]


def step():
    """Time and instructions of one sample: every model, the whole pipeline."""
    need("valgrind", "valgrind")
    told = run("cargo", "bench", "--workspace", "--bench", "step")
    group, name, ns = "", "", {}
    for line in told.splitlines():
        # Lines look like this: ├─ identified; │  ├─ anfis   1.6 ms ...; │  │   9.4 Mitem/s ...
        if label := re.match(r"[│ ]*[├╰]─ ([^│]*?)(?:  .*)?$", line):
            text = label.group(1).strip()
            group, name = (text, "") if re.match(r"[├╰]", line) else (group, text)
            if group == "p" and (found := re.findall(r"([\d.]+) ns", line)):
                ns["p"] = {"p": float(found[2])}
        elif name and len(rates := re.findall(r"([\d.]+) ([KM])item/s", line)) == 4:
            rate, unit = rates[2]
            ns.setdefault(group, {})[name] = 1e9 / (float(rate) * {"K": 1e3, "M": 1e6}[unit])
    counted = run("model/examples/step_cost.sh")
    found = re.findall(r"^  (\S.*?) +(\d+)$", counted, re.MULTILINE)
    worst = run("cargo", "run", "--release", "-p", "mr-damper-model", "--example", "step_cost")
    spread = re.findall(r"^  (\S.*?) +(\d+) +(\d+) +(\d+) +(\d+)$", worst, re.MULTILINE)
    return {
        "ns": ns,
        "instructions": {name: int(count) for name, count in found},
        "single_ns": {name: [int(figure) for figure in figures] for name, *figures in spread},
    }


def round_trip():
    """Displacement out, force_estimate back: the node, a bare echo, an rclpy node, CycloneDDS in C."""
    need("idlc", "cyclonedds-dev cyclonedds-tools")
    if not list(Path(os.environ.get("MR_DAMPER_INTEROP_DIR", "/var/tmp/mr-damper-interop")).glob("jazzy/venv")):
        raise Missing("the rclpy peer needs ROS 2: run tests/interop/setup.sh jazzy")
    build()
    with tempfile.TemporaryDirectory() as folder:
        run("idlc", "-l", "c", INTEROP / "mr_damper.idl", cwd=folder)
        echo = Path(folder) / "cyclone_echo"
        run("cc", "-O2", "-I.", "-o", echo, INTEROP / "cyclone_echo.c", "mr_damper.c", "-lddsc", cwd=folder)
        node = [BINARY, "--quiet", "node", "--ros-args", "-p", f"model:={MODEL}"]
        others = {
            "bare ros2-client echo": [TARGET / "release" / "echo_peer"],
            "this node, no priority": [*node, "-p", "realtime_priority:=0"],
            "this node, priority 20 (the default for root)": [*node, "-p", "realtime_priority:=20"],
            "CycloneDDS echo in C": [echo],
            "rclpy node with the model": [INTEROP / "ros-python.sh", "jazzy", INTEROP / "rclpy_node.py"],
        }
        trips = {name: [] for name in others}
        # In turns, so that a machine that becomes busier affects all of them.
        for turn in range(3):
            for name, command in others.items():
                trips[name].append(trip(command))
                say(f"   {name}, turn {turn + 1} of 3: {trips[name][-1]['p50_us']:.0f} us")
    figures = ["p50_us", "p90_us", "p99_us", "max_us", "lost"]
    return {name: {f: middle([trip[f] for trip in all_]) for f in figures} for name, all_ in trips.items()}


def trip(command, seconds=10):
    """Measures the round trip at 1 kHz with `command`, in a separate network namespace."""
    interface = "<NetworkInterface name='lo' multicast='true'/>"
    uri = f"<CycloneDDS><Domain><General><Interfaces>{interface}</Interfaces></General></Domain></CycloneDDS>"
    script = """
      "${@:2}" >/dev/null 2>&1 & peer=$!
      sleep 1
      "$1/ros-python.sh" jazzy "$1/roundtrip.py" --rate 1000 --seconds "$SECONDS_ASKED"
      kill -INT $peer; wait $peer || true"""
    env = {"ROS_DOMAIN_ID": "84", "CYCLONEDDS_URI": uri, "SECONDS_ASKED": str(seconds)}
    return last_json(run(INTEROP / "netns.sh", "run", "bash", "-uc", script, "trip", INTEROP, *command, env=env))


def scale_of(parameters=(), **options):
    """Runs the example `scale` with a node with `parameters` in a separate network namespace, and returns its result."""
    arguments = [part for name, value in options.items() for part in (f"--{name.replace('_', '-')}", value)]
    arguments += [part for text in parameters for part in ("--parameter", text)]
    example = TARGET / "release" / "examples" / "scale"
    return last_json(run(INTEROP / "netns.sh", "run", example, "--node", BINARY, *arguments))


def scale():
    """Number of dampers times rate in one process: losses and cost."""
    build()
    sizes = [(1, 1000), (4, 250), (4, 512), (4, 1000), (8, 512), (8, 1000), (16, 256), (16, 512), (16, 1000), (32, 256), (32, 512)]
    found = []
    for dampers, rate_hz in sizes:
        found.append(scale_of(dampers=dampers, rate_hz=rate_hz, seconds=10))
        say(f"   {dampers} x {rate_hz} Hz: {found[-1]['lost']} lost, {found[-1]['node_cores']:.2f} of a core")
    return found


def realtime():
    """Worst times of the estimating thread on a busy machine, with and without real-time priority."""
    build()
    found = []
    for busy in (0, 4):
        for priority in (0, 20):
            parameters = [f"realtime_priority:={priority}", "deadline_s:=0.002"]
            told = scale_of(parameters, dampers=1, rate_hz=1000, seconds=30, busy=busy)
            found.append({"busy": busy, "priority": priority, **told})
            say(f"   {busy} busy threads, priority {priority}: {told['said'].get('missed_deadlines')} missed")
    return found


def offline():
    """Recorded runs: evaluate on a bag and a CSV, a bag of 2 GB, a bag played at full speed."""
    build()
    folder = FOLDER / "runs"
    bag, csv = folder / "rp3-cs-01", folder / "rp3-cs-01.csv"
    if not csv.exists():
        shutil.rmtree(folder, ignore_errors=True)
        simulate(folder, 1800)
        run(BINARY, "--quiet", "convert", bag, csv)
    samples = 1800 * 512
    evaluate = [BINARY, "--quiet", "evaluate", MODEL]
    found = {"samples": samples, "messages": messages(bag), "bag_mb": megabytes(bag), "csv_mb": megabytes(csv)}
    for name, path in {"bag": bag, "csv": csv}.items():
        # The first pass loads the file into the system's cache.
        found[name] = min((used(*evaluate, path) for _ in range(4)), key=lambda one: one["seconds"])
    say("   a bag of 2 GB")
    big = FOLDER / "big"
    shutil.rmtree(big, ignore_errors=True)
    simulate(big, 40_000)
    path = big / "rp3-cs-01"
    found["big"] = {"mb": megabytes(path), "messages": messages(path), "samples": 40_000 * 512, **used(*evaluate, path)}
    shutil.rmtree(big)
    found["replay"] = replay(folder)
    return found


def simulate(folder, seconds):
    options = ["--experiment", "RP3-CS", "--replicates", 1, "--duration", seconds, "--format", "mcap"]
    run(BINARY, "--quiet", "simulate", *options, "--out", folder)


def messages(bag):
    return int(re.search(r"^  message_count: (\d+)", (bag / "metadata.yaml").read_text(), re.MULTILINE).group(1))


def megabytes(path):
    files = path.glob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files) / 1e6


def replay(folder):
    """Replays one minute of a run through the node over DDS, as fast as possible."""
    minute = folder / "minute"
    if not minute.exists():
        simulate(minute, 60)
    script = """
      "$0" --quiet node --ros-args -p "model:=$2" >/dev/null 2>&1 & node=$!
      trap 'kill -INT $node; wait $node' EXIT
      began=$EPOCHREALTIME
      "$0" --quiet replay "$1" --rate max --wait 10 >/dev/null
      ended=$EPOCHREALTIME
      echo "{\\"seconds\\": $(awk "BEGIN { print $ended - $began }")}" """
    told = run(INTEROP / "netns.sh", "run", "bash", "-euc", script, BINARY, minute / "rp3-cs-01", MODEL, env={"ROS_DOMAIN_ID": "85"})
    return {"samples": 60 * 512, "seconds": last_json(told)["seconds"]}


def identification():
    """Identification compared with Python tools on one problem, and how its cost grows."""
    table = run("tests/peers/run.sh")
    build()
    folder = FOLDER / "train"
    if not folder.exists():
        run(BINARY, "--quiet", "simulate", "--experiment", "RP-ICPS", "--replicates", 8, "--duration", 30, "--out", folder)
    runs = sorted(folder.glob("*.csv"))
    out = FOLDER / "identified.toml"

    def identify(model, count, *options):
        took = used(BINARY, "--quiet", "identify", "--model", model, *runs[:count], "--out", out, *options)
        return {"model": model, "runs": count, "options": list(options), **took}

    growth = [identify("fuzzy-tanh", count) for count in (1, 2, 4, 8)]
    growth += [identify(model, 4) for model in ("arx", "sp", "bouc-wen", "anfis", "wang-liao")]
    growth += [identify("fuzzy-tanh", 4, "--centres", ",".join(f"{2.5 * k / (n - 1):.2f}" for k in range(n))) for n in (2, 4, 7)]
    return {"table": table, "growth": growth}


def closing():
    """Diagnosis: how its cost grows with the length of the runs and with the number of candidate effects."""
    build()
    found = []
    candidates = [[], ["friction"], ["coil_lag"], CANDIDATES[:4], CANDIDATES]
    for seconds in (20, 30, 60, 120, 600):
        folder = FOLDER / f"closing-{seconds}"
        if not folder.exists():
            options = ["--experiment", "RP-ICPS", "--replicates", 4, "--duration", seconds, "--seed", 11]
            run(BINARY, "--quiet", "simulate", *options, "--out", folder)
        base, estimate, confirm, sealed = sorted(folder.glob("*.csv"))
        model = folder / "base.toml"
        if not model.exists():
            run(BINARY, "--quiet", "identify", "--model", "fuzzy-tanh", base, "--out", model)
        command = [BINARY, "--quiet", "close", "--base", model, "--estimate", estimate, "--confirm", confirm, "--test", sealed]
        jobs = [(True, ids) for ids in (candidates if seconds == 30 else [[]])] + [(False, [])]
        for fixed, ids in jobs:
            options = [*(["--fixed-base"] if fixed else []), *(["--effects", ",".join(ids)] if ids else [])]
            took = used(*command, *options, "--out", folder / "closed.toml")
            found.append({"run_s": seconds, "fixed": fixed, "effects": ids, **took})
            say(f"   3 runs of {seconds} s, {' '.join(options) or 'structure chosen'}: {found[-1]['seconds']:.1f} s")
    return found


def soak():
    """One hour of four dampers at 1 kHz: losses, and growth of memory, threads and files."""
    env = {"MR_DAMPER_LONG": "1", "MR_DAMPER_SOAK_S": "3600"}
    command = ["cargo", "test", "--release", "--workspace", "--test", "soak", "--", "--nocapture"]
    told = run(INTEROP / "netns.sh", "run", *command, env=env)
    return {**soaked(told), "load": os.getloadavg()[2], "nice": os.nice(0)}


def soaked(told):
    lost = re.findall(r"(\w+): (\d+) displacements at (\d+) Hz, (\d+) without an estimate", told)
    used_then = re.search(r"\[memory kB, threads, files\] \[(.*?)\], \[(.*?)\]", told)
    late, unit = re.search(r"the peer was late by ([\d.]+)(\D+) at most", told).groups()
    third, last = ([int(count) for count in group.split(",")] for group in used_then.groups())
    return {
        "dampers": len(lost),
        "rate_hz": int(lost[0][2]),
        "displacements": sum(int(row[1]) for row in lost),
        "lost": sum(int(row[3]) for row in lost),
        "late_s": float(late) * {"s": 1.0, "ms": 1e-3, "µs": 1e-6}[unit],
        "third": third,
        "last": last,
    }


def fuzz():
    """Each fuzz target for one minute: inputs, rate and findings."""
    return fuzzed(run("tests/fuzz/run.sh", "--seed", "1"))


def fuzzed(told):
    rows = re.findall(r"^(\w+) +(\d+) runs +(\d+)/s +(\d+) features +(.*)$", told, re.MULTILINE)
    return [
        {"target": name, "runs": int(runs), "per_s": int(per_s), "features": int(features), "found": found}
        for name, runs, per_s, features, found in rows
    ]


def coverage():
    """Lines of model/ that its own tests execute."""
    return covered(run(".ci/coverage"))


def covered(told):
    rows = [line.split() for line in told.splitlines() if re.match(r"\S+\.rs |TOTAL ", line)]
    lines = {row[0]: [int(row[7]), int(row[8])] for row in rows}
    total = lines.pop("TOTAL")
    least = sorted((1 - missed / count, name) for name, (count, missed) in lines.items() if count >= 40)[:5]
    return {"lines": total[0], "missed": total[1], "least": least}


def mutants():
    """Mutation testing: share of faults in model/ that its tests notice, about a hundred faults in all."""
    return caught(run("bash", "-c", ".ci/mutants 100 1 || true"))


def caught(told):
    found = re.search(r"caught (\d+) of (\d+) \((\d+) %, 95 %: (\d+) to (\d+)\), (\d+) did not compile", told)
    names = ("caught", "of", "percent", "low", "high", "unviable")
    missed = re.findall(r"^MISSED +(\S+?):\d+: (.*?)(?: in [\d.]+s .*)?$", told, re.MULTILINE)
    return {**dict(zip(names, map(int, found.groups()), strict=True)), "missed": [f"{at}: {what}" for at, what in missed]}


# Section: function and approximate time in s.
ALL = {
    "step": (step, 240),
    "round_trip": (round_trip, 220),
    "scale": (scale, 200),
    "realtime": (realtime, 150),
    "offline": (offline, 260),
    "identification": (identification, 200),
    "closing": (closing, 300),
    "fuzz": (fuzz, 1000),
    "coverage": (coverage, 1500),
    "soak": (soak, 3700),
    "mutants": (mutants, 7200),
}
# Sections that are measured only if they are named.
LONG = ("fuzz", "coverage", "soak", "mutants")
