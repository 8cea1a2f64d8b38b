"""Fixtures: simulated runs, and the command ``mr-damper`` of the installed wheel."""

import os
import pathlib
import subprocess
import sys

import pytest

import mr_damper

#: Recorded runs, which are not part of the repository.
DATA = pathlib.Path(os.environ.get("MR_DAMPER_DATA") or pathlib.Path(__file__).resolve().parents[4] / "shared/data")


@pytest.fixture(scope="session")
def command():
    """Runs the command of the wheel and returns the finished process."""
    program = pathlib.Path(sys.executable).with_name("mr-damper")

    def run(*words, check=True):
        done = subprocess.run([program, *map(str, words)], capture_output=True, text=True, timeout=300)
        assert not check or done.returncode == 0, done.stderr
        return done

    run.program = program
    return run


@pytest.fixture(scope="session")
def folder(tmp_path_factory, command):
    """A folder with three simulated runs as CSV files."""
    folder = tmp_path_factory.mktemp("runs")
    command("--quiet", "simulate", "--experiment", "RP3-CS", "--replicates", "3", "--duration", "6", "--out", folder)
    return folder


@pytest.fixture(scope="session")
def files(folder):
    """The paths of the runs."""
    return [folder / f"rp3-cs-0{number}.csv" for number in (1, 2, 3)]


@pytest.fixture(scope="session")
def fitted(files):
    """A small fitted model."""
    return mr_damper.DamperModel("fuzzy-tanh", restarts=2, sets=3).fit(files[:1], validate=files[1:2])
