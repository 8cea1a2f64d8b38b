"""Validates an FMU with FMPy, and steps it through readings there.

usage: fmpy_steps.py FOLDER INPUT...

Reads FOLDER/model.fmu and FOLDER/in.bin; INPUTs are value references of the inputs among the readings. Writes FOLDER/out.bin. The layouts are
those of the driver: see driver.rs. The functions of the FMU are called as FMPy declares them, with arrays that are made once: FMPy's own
methods make them at each call, which takes most of the time.
"""

import struct
import sys
from ctypes import byref, c_bool, c_double, c_int, c_uint32
from pathlib import Path

from fmpy import extract, instantiate_fmu, read_model_description
from fmpy.validation import validate_fmu

STEP_S = 1e-3
READINGS = struct.Struct("<q5d")
RESULTS = struct.Struct("<IIdd")
ESTIMATES, FLAGS, TRUTHS = (11, 12), (15,), (16, 17)


def array(kind, values):
    return (kind * len(values))(*values)


def steps(fmu, is_3, inputs):
    """A function that makes one step: time and readings to accepted, flags, force and expected reading."""
    component, count = fmu.component, len(inputs)
    given, into = array(c_uint32, inputs), (c_double * count)()
    estimates, flags, truths = array(c_uint32, ESTIMATES), array(c_uint32, FLAGS), array(c_uint32, TRUTHS)
    numbers = (c_double * 2)()
    places = [reference - 1 for reference in inputs]
    if is_3:
        words, is_true = (c_uint32 * 1)(), (c_bool * 2)()
        event, ends, early, reached_s = c_bool(), c_bool(), c_bool(), c_double()
    else:
        words, is_true = (c_int * 1)(), (c_int * 2)()

    def step(time_ns, *readings):
        for k, place in enumerate(places):
            into[k] = readings[place]
        time_s = time_ns * 1e-9
        if is_3:
            fmu.fmi3SetFloat64(component, given, count, into, count)
            fmu.fmi3DoStep(component, time_s, STEP_S, True, byref(event), byref(ends), byref(early), byref(reached_s))
            fmu.fmi3GetFloat64(component, estimates, 2, numbers, 2)
            fmu.fmi3GetUInt32(component, flags, 1, words, 1)
            fmu.fmi3GetBoolean(component, truths, 2, is_true, 2)
        else:
            fmu.fmi2SetReal(component, given, count, into)
            fmu.fmi2DoStep(component, time_s, STEP_S, 1)
            fmu.fmi2GetReal(component, estimates, 2, numbers)
            fmu.fmi2GetInteger(component, flags, 1, words)
            fmu.fmi2GetBoolean(component, truths, 2, is_true)
        force_n, reading_n = numbers
        valid, accepted = bool(is_true[0]), bool(is_true[1])
        if valid != (force_n == force_n):
            sys.exit(f"at {time_s} s valid is {valid}, and the force is {force_n}")
        return accepted, words[0], force_n, reading_n

    return step


def main():
    folder, inputs = Path(sys.argv[1]), [int(text) for text in sys.argv[2:]]
    model = folder / "model.fmu"
    problems = validate_fmu(str(model))
    if problems:
        sys.exit("\n".join(map(str, problems)))
    description = read_model_description(str(model))
    is_3 = description.fmiVersion.startswith("3")
    unzipped = extract(str(model), unzipdir=str(folder / "unzipped"))
    fmu = instantiate_fmu(unzipped, description, fmi_type="CoSimulation")
    if not is_3:
        fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    step = steps(fmu, is_3, inputs)
    with open(folder / "out.bin", "wb") as out:
        for readings in READINGS.iter_unpack((folder / "in.bin").read_bytes()):
            out.write(RESULTS.pack(*step(*readings)))
    fmu.terminate()
    fmu.freeInstance()


if __name__ == "__main__":
    main()
