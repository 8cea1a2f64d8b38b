"""Compares our FIS files with fuzzylite 6.0, an independent reader of them, on a grid of inputs.

usage: fis_peer.py MR_DAMPER FIS_GRID FIS_FUZZYLITE

MR_DAMPER is the command, FIS_GRID the example `fis_grid` of the model crate, FIS_FUZZYLITE the program of fis_fuzzylite.cpp, which says
how to build it. The script

1. simulates two runs of RP-ICPS of 30 s, and identifies anfis, tsk-324, tsk-555 and tsk-wang-hu with --fis on the first;
2. converts SHAPES, one system for each shape of MATLAB that the reader knows, to a model file, and back to a FIS file;
3. evaluates each FIS file with fuzzylite, and each model file with fis_grid, on the same grid over the ranges of the file;
4. prints the largest difference of each, relative to the largest output. The exit code is 1 if one exceeds 1e-9.
"""

import itertools
import re
import subprocess
import sys
import tempfile
from pathlib import Path

LIMIT = 1e-9
STEPS = 17
MODELS = ["anfis", "tsk-324", "tsk-555", "tsk-wang-hu"]
SHAPES = {
    "gbellmf": ["'gbellmf',[1 2 -2]", "'gbellmf',[1.5 0.7 0]", "'gbellmf',[1 4.5 2]"],
    "gauss2mf": ["'gauss2mf',[0.5 -2 0.8 -1]", "'gauss2mf',[0.7 1 0.4 0]", "'gauss2mf',[1 2 0.3 2]"],
    "trapmf": ["'trapmf',[-4 -3 -1.5 0]", "'trapmf',[-2 0 0 1.5]", "'trapmf',[0.5 2 3 4]"],
    "trimf": ["'trimf',[-4 -2 0.5]", "'trimf',[-3.5 0 1.5]", "'trimf',[-1 2 4]"],
    "gaussmf": ["'gaussmf',[0.9 -2]", "'gaussmf',[0.5 0.5]", "'gaussmf',[1.2 2]"],
}


def system(functions):
    """A system of one input with these memberships and first-order conclusions."""
    count = len(functions)
    sets = "\n".join(f"MF{k}='s{k}':{f}" for k, f in enumerate(functions, 1))
    lines = "\n".join(f"MF{k}='o{k}':'linear',[{0.3 * k} {k - 2}]" for k in range(1, count + 1))
    rules = "\n".join(f"{k}, {k} (1) : 1" for k in range(1, count + 1))
    return (
        f"[System]\nName='s'\nType='sugeno'\nVersion=2.0\nNumInputs=1\nNumOutputs=1\nNumRules={count}\nAndMethod='prod'\n"
        f"OrMethod='probor'\nImpMethod='prod'\nAggMethod='sum'\nDefuzzMethod='wtaver'\n\n[Input1]\nName='velocity'\nRange=[-3 3]\n"
        f"NumMFs={count}\n{sets}\n\n[Output1]\nName='force'\nRange=[-4 4]\nNumMFs={count}\n{lines}\n\n[Rules]\n{rules}\n"
    )


def grid(fis, path):
    """Writes points over the ranges of the inputs of a FIS file; the ends belong to it."""
    inputs = re.findall(r"\[Input\d+\]\nName='[^']*'\nRange=\[(\S+) (\S+)\]", fis.read_text())
    steps = STEPS if len(inputs) > 1 else 601
    axes = []
    for low, high in inputs:
        low, high = float(low), float(high)
        axes.append([min(high, low + (high - low) * k / (steps - 1)) for k in range(steps)])
    path.write_text("".join(" ".join(map(repr, point)) + "\n" for point in itertools.product(*axes)))


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: {done.stderr or done.stdout}")
    return done.stdout


def compare(name, fis, model, fis_grid, fuzzylite, directory):
    points = directory / "grid.txt"
    grid(fis, points)
    theirs = [float(line) for line in run(fuzzylite, fis, points).split()]
    ours = [float(line) for line in run(fis_grid, model, points).split()]
    assert len(theirs) == len(ours) == len(points.read_text().splitlines()), name
    # A number that is not finite fails: nan <= LIMIT is false.
    size = max(map(abs, theirs))
    worst = max((abs(a - b) / size for a, b in zip(theirs, ours)), key=lambda d: (d != d, d))
    print(f"{name:<24} {len(ours):>6} points, largest relative difference {worst:.1e}")
    return worst <= LIMIT


def main():
    if len(sys.argv) != 4:
        sys.exit("usage: fis_peer.py MR_DAMPER FIS_GRID FIS_FUZZYLITE")
    mr_damper, fis_grid, fuzzylite = (Path(path).resolve() for path in sys.argv[1:])
    fine = []
    with tempfile.TemporaryDirectory() as directory:
        directory = Path(directory)
        run(mr_damper, "--quiet", "simulate", "--experiment", "RP-ICPS", "--replicates", "2", "--duration", "30", "--out", directory)
        runs = sorted(directory.glob("*.csv"))
        for model in MODELS:
            toml, fis = directory / f"{model}.toml", directory / f"{model}.fis"
            run(mr_damper, "--quiet", "identify", "--model", model, runs[0], "--out", toml, "--fis", fis)
            fine.append(compare(model, fis, toml, fis_grid, fuzzylite, directory))
        for shape, functions in SHAPES.items():
            fis, toml, back = (directory / f"{shape}{end}" for end in (".fis", ".toml", "-back.fis"))
            fis.write_text(system(functions))
            run(mr_damper, "--quiet", "convert", fis, toml, "--rate", "512")
            run(mr_damper, "--quiet", "convert", toml, back)
            fine.append(compare(shape, fis, toml, fis_grid, fuzzylite, directory))
            fine.append(compare(f"{shape}, written back", back, toml, fis_grid, fuzzylite, directory))
    sys.exit(0 if all(fine) else 1)


if __name__ == "__main__":
    main()
