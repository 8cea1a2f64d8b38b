#!/usr/bin/env python3
"""Measures the cost of the service in comparison with its peers, and writes node/docs/BENCHMARKS.md.

    tests/bench/bench.py                      # all sections that take minutes: half an hour on two cores; needs an idle machine
    tests/bench/bench.py step round_trip      # measures these sections again; the others keep their results
    tests/bench/bench.py soak                 # sections that take longer are run by name only: fuzz, coverage, soak, mutants
    tests/bench/bench.py --list
    tests/bench/bench.py --document           # measures nothing, writes the document from the latest results

Needs cargo, valgrind (instructions), idlc and CycloneDDS for C (Debian: cyclonedds-dev cyclonedds-tools) and the peers that
`tests/interop/setup.sh jazzy` installs (round_trip). If something is missing, it is reported and the section keeps its results.
Servers run in their own network namespace. Results are in $MR_DAMPER_BENCH_DIR (default /var/tmp/mr-damper-bench), one JSON file
per section.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import document
import sections
from common import FOLDER, ROOT, Missing, say


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("section", nargs="*", help="section to measure; default: all that take minutes")
    parser.add_argument("--list", action="store_true", help="list the sections with their approximate times")
    parser.add_argument("--document", action="store_true", help="only write the document")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.section if name not in sections.ALL]
    if unknown:
        parser.error(f"unknown section {unknown[0]}; sections are {', '.join(sections.ALL)}")
    return arguments


def machine():
    cpu = "an unknown processor"
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            cpu = line.split(":", 1)[1].strip()
            break
    memory_kb = int(Path("/proc/meminfo").read_text().split()[1])
    rustc = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=True).stdout.strip()
    system = os.uname()
    return f"{os.cpu_count()} cores of {cpu}, {memory_kb / 2**20:.0f} GiB, {system.sysname} {system.release}, {rustc}"


def commit():
    def git(*arguments):
        return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    changed = [line for line in git("status", "--short").splitlines() if not line.endswith("BENCHMARKS.md")]
    return git("rev-parse", "--short", "HEAD") + (" and changes" if changed else "")


def measure(name):
    measured, about_s = sections.ALL[name]
    say(f"== {name}: about {about_s} s")
    began = time.monotonic()
    figures = measured()
    result = {
        "section": name,
        "when": time.strftime("%Y-%m-%d"),
        "machine": machine(),
        "commit": commit(),
        "took_s": round(time.monotonic() - began),
        "figures": figures,
    }
    (FOLDER / f"{name}.json").write_text(json.dumps(result, indent=1))
    say(f"== {name}: {result['took_s']} s")


def main():
    arguments = parse_arguments()
    if arguments.list:
        for name, (measured, about_s) in sections.ALL.items():
            print(f"{name:<16} {about_s:>4} s   {measured.__doc__.splitlines()[0]}")
        return 0
    FOLDER.mkdir(parents=True, exist_ok=True)
    left_out = []
    if not arguments.document:
        for name in arguments.section or [name for name in sections.ALL if name not in sections.LONG]:
            try:
                measure(name)
            except Missing as missing:
                left_out.append(f"{name} LEFT OUT: {missing}")
                say(left_out[-1])
    results = {path.stem: json.loads(path.read_text()) for path in FOLDER.glob("*.json")}
    document.write(results, list(sections.ALL))
    for line in left_out:
        say(line)
    return 1 if left_out else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        say("interrupted; results of finished sections are kept, and --document writes them")
        sys.exit(130)
