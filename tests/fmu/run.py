#!/usr/bin/env python3
"""Validates exported FMUs with FMPy, and runs them in it: their outputs must have the service's bits.

usage: tests/fmu/run.py            MR_DAMPER_BIN: the program; default target/release/mr-damper

For each model, without an effect and with one, and for FMI 3.0 and 2.0: FMPy validates the FMU. It then steps through the test vectors that
`mr-damper export` writes beside the FMU, in which readings are lost, late, NaN or impossible. FMPy's own simulation of a sine must agree
with these steps. A source-only FMU is compiled by FMPy and must give the same. FMUs with an inverse controller, by search and by surrogates,
are tested in the same way. Prints a line for each FMU; the exit code is 1 if one fails.
"""

import csv
import math
import os
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description, simulate_fmu
from fmpy.validation import validate_fmu

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("MR_DAMPER_BIN", str(ROOT / "target/release/mr-damper"))
SAMPLES = int(os.environ.get("MR_DAMPER_EXPORT_SAMPLES", "20000"))
HEAD = """schema = "mr-damper/model/1"
model = "{model}"
{drive}{effects}
[parameters]
{parameters}
[conditioning]
rate_hz = 512.0
apply_to = "inputs"
cutoff_hz = 20.0
velocity = "backward"
slope_window_s = 0.01

[expected]
free_run_rsse_n = 100.0

[provenance]
tool = "tests/fmu/run.py"
date = ""
seed = 0
restarts = 0
runs = []
"""
NO_EFFECT = "effects = []\n"


def effect(name, **parameters):
    return f"effects = [{{ id = \"{name}\", {', '.join(f'{key} = {value}' for key, value in parameters.items())} }}]\n"


def preset(name, effects):
    """The model file of a preset, with other effects."""
    text = subprocess.run([PROGRAM, "presets", name], check=True, capture_output=True, text=True).stdout
    assert NO_EFFECT in text, text
    return text.replace(NO_EFFECT, effects)


def bouc_wen(effects):
    parameters = {
        "high_velocity_damping_n_s_m": 900.0, "low_velocity_damping_n_s_m": 8000.0, "high_velocity_stiffness_n_m": 1200.0,
        "accumulator_stiffness_n_m": 300.0, "hysteresis_force_n": 250.0, "hysteresis_gamma_per_m": 300.0,
        "hysteresis_exponent": 2.0, "hysteresis_beta_per_m": 200.0, "hysteresis_slope_per_m": 200.0,
    }
    text = "force_offset_n = 3.5\ndependence = \"none\"\n" + "".join(f"{key} = {value!r}\n" for key, value in parameters.items())
    return HEAD.format(model="bouc-wen", drive="", effects=effects, parameters=text)


def chen(effects):
    """A network with weights that differ from each other."""
    hidden, inputs = 25, 7
    row = lambda k, n: [0.3 * math.sin(1.7 * (k + j)) for j in range(n)]
    parameters = {
        "sample_period_s": 0.001, "force_offset_n": 6.0, "force_deviation_n": 450.0,
        "displacement_mean_m": 0.001, "displacement_deviation_m": 0.008, "velocity_mean_m_s": 0.0,
        "velocity_deviation_m_s": 0.12, "current_mean_a": 1.2, "current_deviation_a": 0.9,
        "hidden_weights": [row(inputs * k, inputs) for k in range(hidden)], "hidden_biases": row(200, hidden),
        "output_weights": row(300, hidden), "output_bias": 0.1,
    }
    text = "".join(f"{key} = {value!r}\n" for key, value in parameters.items())
    return HEAD.format(model="chen", drive='drive = "current_a"\n', effects=effects, parameters=text)


LAG = effect("coil_lag", form="\"one_tau\"", tau_s=0.008)
MODELS = [
    ("fuzzy-tanh", lambda effects: preset("thesis/fuzzy-tanh/rp3-cs", effects), LAG),
    ("bouc-wen", bouc_wen, effect("force_lag", form="\"series_spring\"", compliance_m_n=1e-6)),
    ("chen", chen, effect("friction", friction_n=25.0)),
    ("arx", lambda effects: preset("thesis/arx-semi-active/rp-icps-l", effects), effect("load_cell_drift", rate_n_s=0.5)),
]
LIMITS = ["--current-max", "1.8", "--rate-max", "60"]
# Models with an inverse controller, by these methods.
INVERSES = [
    ("fuzzy-tanh", lambda: preset("thesis/fuzzy-tanh/rp3-cs", NO_EFFECT), "search", []),
    ("fuzzy-tanh with coil lag", lambda: preset("thesis/fuzzy-tanh/rp3-cs", LAG), "search", LIMITS),
    ("fuzzy-tanh with coil lag", lambda: preset("thesis/fuzzy-tanh/rp3-cs", LAG), "polynomial", LIMITS),
    ("fuzzy-tanh with coil lag", lambda: preset("thesis/fuzzy-tanh/rp3-cs", LAG), "fuzzy", LIMITS),
    ("chen", lambda: chen(NO_EFFECT), "search", LIMITS),
]
NUMBERS, WORDS, TRUTHS = ["force_n", "reading_n"], ["flags"], ["valid", "accepted"]
# The same of an inverse controller; forces are those in the test vectors, too.
FORCES = ["requested_n", "expected_n", "least_n", "most_n"]
COMMAND_NUMBERS = ["current_a", "requested_n", "expected_n", "achievable_n"]
COMMAND_TRUTHS = ["is_commanded", "is_achievable", "is_dissipative", "is_substituted"]  # the last of a learned inverse


def bits(value):
    """The bits of a number; all NaN are equal."""
    return "NaN" if math.isnan(value) else struct.pack("<d", value)


class Stepped:
    """An instance that is stepped call by call."""

    def __init__(self, folder, description):
        self.fmu = instantiate_fmu(folder, description, fmi_type="CoSimulation")
        self.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.is_3 = description.fmiVersion.startswith("3")
        self.numbers, self.words, self.truths = outputs_of(description)
        # Numbers of a call; FMI 2.0 has no arrays.
        self.count = len(self.numbers) + (self.is_3 and "command.achievable_n" in self.references)
        if self.is_3:
            self.fmu.enterInitializationMode()
        else:
            self.fmu.setupExperiment()
            self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def of(self, names):
        return [self.references[name] for name in names]

    def outputs(self):
        """Numbers, integers and Booleans, in the order of outputs_of."""
        if self.is_3:
            numbers = self.fmu.getFloat64(self.of(self.numbers), nValues=self.count)
            words = self.fmu.getUInt32(self.of(self.words))
        else:
            numbers, words = self.fmu.getReal(self.of(self.numbers)), self.fmu.getInteger(self.of(self.words))
        return [*numbers, *(int(word) for word in words), *(bool(truth) for truth in self.fmu.getBoolean(self.of(self.truths)))]

    def step(self, time_s, step_s, inputs):
        (self.fmu.setFloat64 if self.is_3 else self.fmu.setReal)(self.of(inputs), list(inputs.values()))
        self.fmu.doStep(time_s, step_s)
        return self.outputs()

    def end(self):
        self.fmu.terminate()
        self.fmu.freeInstance()


def outputs_of(description):
    """The names of the outputs that are compared: numbers, integers, Booleans."""
    names = [variable.name for variable in description.modelVariables if variable.causality == "output"]
    if not any(name.startswith("command.") for name in names):
        return NUMBERS, WORDS, TRUTHS
    numbers = [name for name in names if name.removeprefix("command.").partition("[")[0] in COMMAND_NUMBERS]
    truths = [f"command.{name}" for name in COMMAND_TRUTHS if f"command.{name}" in names]
    return NUMBERS + numbers, WORDS + ["command.limited_by"], TRUTHS + truths


def inputs_of(description):
    return [variable.name for variable in description.modelVariables if variable.causality == "input"]


def number(text):
    return float(text) if text else math.nan


def has_command(found, row):
    """True if the outputs of the inverse controller are those of the test vector, bit for bit."""
    (current_a, *forces), (limited_by,), (is_commanded, *truths) = found
    # Before the first command the vectors have no current, and the FMU has the safe one.
    is_same = math.isfinite(current_a) and (row["applied_a"] == "" or bits(current_a) == bits(number(row["applied_a"])))
    if row["command_a"] == "":
        return is_same and not is_commanded
    is_same &= [bits(force) for force in forces] == [bits(number(row[name])) for name in FORCES]
    is_same &= truths == [row[name] == "1" for name in COMMAND_TRUTHS[1:] if name in row]
    return is_same and is_commanded and limited_by == int(row["limited_by"])


def against_vectors(folder, description, vectors):
    """Number of samples that differ from the test vectors, of those with a force, and of those whose displacement is lost in a long gap, so
    that the current goes to the safe one."""
    instance = Stepped(folder, description)
    names = inputs_of(description)
    different = forces = silent = 0
    held_a = math.nan
    for row in vectors:
        inputs = {name: number(row[name]) for name in names}
        found = instance.step(int(row["time_ns"]) * 1e-9, 1e-3, inputs)
        count, words = instance.count, len(instance.words)
        numbers, words, truths = found[:count], found[count : count + words], found[count + words :]
        (force_n, reading_n), flags, (valid, accepted) = numbers[:2], words[0], truths[:2]
        is_same = bits(force_n) == bits(number(row["force_n"])) and accepted == (row["accepted"] == "1")
        # The service gives no reading where the measured force meets no displacement, and no flags for a refused line.
        reading = row.get("reading_n", "")
        is_same &= reading == "" or bits(reading_n) == bits(number(reading))
        is_same &= not accepted or flags == int(row["flags"])
        is_same &= valid == (not math.isnan(force_n))
        if "command_a" in row:
            is_same &= has_command((numbers[2:], words[1:], truths[2:]), row)
            silent += not accepted and numbers[2] != held_a
            held_a = numbers[2]
        different += not is_same
        forces += valid
    instance.end()
    return different, forces, silent


def against_simulation(folder, description):
    """Number of samples at which FMPy's own simulation differs from single steps with the inputs that it recorded."""
    names = inputs_of(description)
    step_s = 1.0 / 512.0
    times = np.arange(2049) * step_s
    signals = {
        "displacement_m": 0.01 * np.sin(2 * math.pi * 2.0 * times),
        "current_a": 1.2 + np.sin(2 * math.pi * 0.7 * times),
        "force_request_n": 600.0 * np.cos(2 * math.pi * 2.0 * times),
    }
    table = np.array(list(zip(times, *(signals[n] for n in names))), dtype=[("time", float)] + [(n, float) for n in names])
    instance = Stepped(folder, description)
    outputs = instance.numbers + instance.words + instance.truths
    recorded = simulate_fmu(
        str(folder), start_time=0.0, stop_time=times[-1], output_interval=step_s, step_size=step_s, input=table,
        output=names + outputs, fmi_type="CoSimulation", model_description=description,
    )
    different = 0
    for before, after in zip(recorded[:-1], recorded[1:]):
        found = instance.step(before["time"], after["time"] - before["time"], {n: float(after[n]) for n in names})
        # An array of FMI 3.0 is one entry.
        expected = [float(value) for name in outputs for value in np.atleast_1d(after[name])]
        different += [bits(float(v)) for v in found] != [bits(v) for v in expected]
    instance.end()
    forces = int(np.sum(recorded["valid"]))
    assert forces > 2000, f"only {forces} of {len(recorded)} samples of the simulation have a force"
    if "command.current_a" in outputs:
        currents = np.unique(recorded["command.current_a"])
        assert len(currents) > 100, f"the simulation commands only {len(currents)} different currents"
    return different


def compile_sources(unzipped):
    """Lets FMPy compile the sources; what CMake says is shown only if it fails."""
    # FMPy's CMake is beside its Python.
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    code = f"from fmpy.build import build_platform_binary; build_platform_binary({str(unzipped)!r})"
    done = subprocess.run([sys.executable, "-c", code], env={**os.environ, "PATH": path}, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"FMPy cannot compile the sources of {unzipped}:\n{done.stdout}\n{done.stderr}")


def check(name, text, version, folder, options=()):
    model, fmu, vectors = folder / "model.toml", folder / "model.fmu", folder / "vectors.csv"
    model.write_text(text)
    command = [PROGRAM, "export", model, "--fmu", fmu, "--fmi", version, "--vectors", vectors, "--vector-count", str(SAMPLES)]
    subprocess.run([*command, "--quiet", *options], check=True)
    problems = validate_fmu(str(fmu))
    description = read_model_description(str(fmu))
    with open(vectors, newline="") as file:
        rows = list(csv.DictReader(file))
    unzipped = Path(extract(str(fmu), unzipdir=str(folder / "unzipped")))
    different, forces, silent = against_vectors(unzipped, description, rows)
    simulated = against_simulation(unzipped, description)
    sources = Path(extract(str(fmu), unzipdir=str(folder / "sources")))
    shutil.rmtree(sources / "binaries")
    compile_sources(sources)
    rebuilt, *_ = against_vectors(sources, description, rows)
    going = f", {silent} go to the safe current" if options else ""
    print(
        f"{name:36} FMI {version}: {len(problems)} issues; of {len(rows)} samples, {forces} with a force{going}, {different} differ; "
        f"compiled by FMPy {rebuilt} differ; simulation {simulated} differ",
        flush=True,
    )
    for problem in problems:
        print(f"  {problem}")
    # With an inverse controller the vectors lose the measured current for long times. Commands go on then, and estimates do not.
    commands = sum(row.get("expected_n", "") != "" for row in rows)
    has_seen = commands > 0.5 * len(rows) and silent > 20 if options else forces > 0.7 * len(rows)
    return not (problems or different or rebuilt or simulated) and has_seen


def main():
    failed = 0
    for name, model, added in MODELS:
        for title, effects in [(name, NO_EFFECT), (f"{name} with effect", added)]:
            for version in ["3.0", "2.0"]:
                with tempfile.TemporaryDirectory() as folder:
                    failed += not check(title, model(effects), version, Path(folder))
    for name, model, method, limits in INVERSES:
        for version in ["3.0", "2.0"]:
            with tempfile.TemporaryDirectory() as folder:
                options = ["--inverse", method, *limits]
                failed += not check(f"{name}, {method}", model(), version, Path(folder), options)
    print(f"{failed} FMUs failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
