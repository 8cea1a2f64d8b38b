"""Shared by the benchmarks: paths, running programs, missing requirements."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(os.environ.get("MR_DAMPER_BENCH_DIR", "/var/tmp/mr-damper-bench"))
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
BINARY = TARGET / "release" / "mr-damper"
INTEROP = ROOT / "tests" / "interop"


class Missing(Exception):
    """A requirement of a section is missing on this machine; the text says which, and how to install it."""


def say(text):
    print(text, file=sys.stderr, flush=True)


def need(program, package):
    if not shutil.which(program):
        raise Missing(f"{program} is not on PATH; on Debian: apt-get install {package}")


def run(*command, cwd=ROOT, env=None):
    """Runs a program and returns its standard output; if it fails, prints its errors and ends the benchmark."""
    ended = subprocess.run(
        [str(part) for part in command], cwd=cwd, env={**os.environ, **(env or {})}, capture_output=True, text=True
    )
    if ended.returncode != 0:
        say(ended.stdout[-2000:] + ended.stderr[-4000:])
        raise SystemExit(f"{' '.join(map(str, command))}: exit code {ended.returncode}")
    return ended.stdout


def last_json(text):
    """The last line of `text` that is a JSON object."""
    return json.loads([line for line in text.splitlines() if line.startswith("{")][-1])


def used(*command, cwd=ROOT):
    """Runs a program; returns its run time in s, processor time in s and largest resident memory in MB."""
    with open(FOLDER / "log", "w") as log:
        began = time.monotonic()
        child = subprocess.Popen([str(part) for part in command], cwd=cwd, stdout=log, stderr=log)
        _, status, usage = os.wait4(child.pid, 0)
        took_s = time.monotonic() - began
    if status != 0:
        raise SystemExit(f"{' '.join(map(str, command))}: {(FOLDER / 'log').read_text()[-2000:]}")
    return {
        "seconds": took_s,
        "processor_s": usage.ru_utime + usage.ru_stime,
        "memory_mb": usage.ru_maxrss / 1024,
    }


def build():
    """Builds release binaries and examples, before anything is timed."""
    run("cargo", "build", "--release", "--workspace", "--bins", "--examples")


def middle(values):
    """The median."""
    ordered = sorted(values)
    half = len(ordered) // 2
    return ordered[half] if len(ordered) % 2 else (ordered[half - 1] + ordered[half]) / 2
