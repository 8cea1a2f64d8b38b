#!/usr/bin/env python3
"""Compares the numbers that two builds of mr-damper print, digit by digit.

    tests/measured/same_numbers.py OLD NEW      # paths of the two programs; takes a minute on two cores

Both programs simulate runs with a coil lag on the virtual rig, and identify, evaluate, compare, diagnose and invert models on them; and
on measured runs, if MR_DAMPER_DATA (default: ../shared/data next to the checkout) has them. Simulated files are compared as a whole,
JSON and model files key by key as they are written. Times of computation, dates, and names of program versions are left out. A key
that only one program writes is listed, and is no difference. The exit code is 1 if a number or a text differs.
"""

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

DATA = Path(os.environ.get("MR_DAMPER_DATA", Path(__file__).resolve().parents[3] / "shared" / "data")) / "utfsm-mr"
# Parts of keys whose values differ from call to call.
LEFT_OUT = ("seconds", "took_s", "_per_s", "date", "tool", "version", "generated")
RIG = [f"runs/rp-icps-{number:02}.csv" for number in range(1, 5)]


def commands():
    """Each command's arguments; all programs write into the working directory."""
    simulate = ["--experiment", "RP-ICPS", "--replicates", "4", "--duration", "20", "--seed", "11", "--effect", "coil_lag=0.012"]
    yield ["simulate", *simulate, "--out", "runs"]
    for model in ("fuzzy-tanh", "arx", "bouc-wen", "anfis"):
        yield ["identify", "--model", model, *RIG[:2], "--out", f"{model}.toml", "--json", f"identify-{model}.json"]
        yield ["evaluate", f"{model}.toml", *RIG[2:], "--json", f"evaluate-{model}.json"]
    for preset in ("thesis/fuzzy-tanh/rp3-cs", "thesis/anfis/rp-icps", "thesis/arx-semi-active/rp-icps", "thesis/sp-semi-active/rp-icps"):
        yield ["evaluate", preset, RIG[3], "--json", f"evaluate-{preset.replace('/', '-')}.json"]
    yield ["compare", "runs", "--models", "arx,sp,fuzzy-tanh,lpv,p", "--semi-active-only", "--json", "compare.json"]
    yield [
        *("close", "--base", "fuzzy-tanh.toml", "--estimate", *RIG[:2], "--confirm", RIG[2], "--test", RIG[3]),
        *("--out", "augmented.toml", "--json", "close.json"),
    ]
    yield ["evaluate", "augmented.toml", RIG[3], "--json", "evaluate-augmented.json"]
    yield ["inverse", "--force", RIG[3], "augmented.toml", "--json", "inverse.json"]
    if DATA.is_dir():
        [train, confirm, test] = [sorted(map(str, DATA.glob(f"sine-{name}*.csv"))) for name in ("[12]?mm", "5mm3hz", "5mm4hz")]
        rate = ["--rate", "200"]
        yield ["identify", "--model", "fuzzy-tanh", *train, *rate, "--out", "measured.toml", "--json", "identify-measured.json"]
        yield ["evaluate", "measured.toml", *test, "--json", "evaluate-measured.json"]
        yield [
            *("close", "--base", "fuzzy-tanh", "--estimate", *train, "--confirm", *confirm, "--test", *test, *rate),
            *("--out", "measured+.toml", "--json", "close-measured.json"),
        ]
    else:
        print(f"measured runs: LEFT OUT, there is no folder {DATA} (MR_DAMPER_DATA)", file=sys.stderr)


def results(program, folder):
    """Runs every command with `program` in `folder` and returns all values that it wrote, by file and key."""
    for arguments in commands():
        ended = subprocess.run([program, "--quiet", *arguments], cwd=folder, capture_output=True, text=True)
        if ended.returncode != 0:
            sys.exit(f"{program} {' '.join(arguments)}: exit code {ended.returncode}\n{ended.stderr[-2000:]}")
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.suffix == ".csv":
            found[name] = path.read_text()
        elif path.suffix in (".json", ".jsonl"):
            # Numbers stay the texts that they are.
            for line, text in enumerate(path.read_text().splitlines() if path.suffix == ".jsonl" else [path.read_text()]):
                flatten(f"{name}:{line}", json.loads(text, parse_float=str, parse_int=str), found)
        elif path.suffix == ".toml":
            flatten(name, tomllib.loads(path.read_text(), parse_float=str), found)
    return found


def flatten(key, value, found):
    if isinstance(value, dict):
        for name, inner in value.items():
            if not any(part in name for part in LEFT_OUT):
                flatten(f"{key} {name}", inner, found)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            flatten(f"{key}[{index}]", inner, found)
    else:
        found[key] = value


def main():
    if len(sys.argv) != 3 or "--help" in sys.argv:
        sys.exit(__doc__)
    programs = [Path(text).resolve() for text in sys.argv[1:]]
    with tempfile.TemporaryDirectory() as folder:
        folders = [Path(folder, name) for name in ("old", "new")]
        for each in folders:
            each.mkdir()
        old, new = (results(program, each) for program, each in zip(programs, folders))
    for name, keys in {"OLD": old.keys() - new.keys(), "NEW": new.keys() - old.keys()}.items():
        for key in sorted(keys):
            print(f"only {name} writes {key}")
    both = sorted(old.keys() & new.keys())
    different = [key for key in both if old[key] != new[key]]
    for key in different:
        print(f"{key}: {str(old[key])[:60]} became {str(new[key])[:60]}")
    print(f"{len(both)} values, {len(different)} differ")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
