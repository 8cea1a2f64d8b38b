#!/usr/bin/env python3
"""Time to identify the tanh law with 15 coefficients and 25 restarts: this package against scipy.

usage: scipy_lm.py [RESTARTS]      default: 25; needs numpy and scipy

Both fit one run of the virtual rig (RP3-CS, 20 s, 512 Hz) by least squares from random starts:

    F = A1(i) tanh(A3(i) u) + A2(i) u,   u = v + kappa(i) x,   each of the five (offset included) of degree two in the current i

scipy runs `curve_fit(method="lm")` (MINPACK with finite differences) on NumPy arrays. Prints seconds and the RMSE of both.
"""

import sys
import time

import numpy
from scipy.optimize import OptimizeWarning, curve_fit

import mr_damper


def law(inputs, *p):
    """The force, N. `p` holds three coefficients each of A1, A3, A2, kappa, and of the offset."""
    x, v, i = inputs
    a1, a3, a2, kappa, offset = (p[3 * k] + p[3 * k + 1] * i + p[3 * k + 2] * i * i for k in range(5))
    u = v + kappa * x
    return a1 * numpy.tanh(a3 * u) + a2 * u + offset


def main():
    restarts = int(sys.argv[1]) if len(sys.argv) > 1 else 25
    (run,) = mr_damper.simulate("RP3-CS", replicates=1, duration=20)
    began = time.perf_counter()
    model = mr_damper.DamperModel("sp", restarts=restarts, velocity="backward").fit(run)
    own_s = time.perf_counter() - began
    own_n = model.result_.training.free_run.rsse_n

    columns = {name: numpy.frombuffer(values) for name, (_, values) in run.traces().items()}
    t = numpy.frombuffer(run.traces()["displacement_m"][0], "i8") * 1e-9
    x, i, force = columns["displacement_m"], columns["current_a"], columns["force_n"]
    v = numpy.gradient(x, t)
    moving = numpy.abs(v) > 0.05 * numpy.abs(v).max()
    inputs, force = numpy.array([x, v, i])[:, moving], force[moving]
    random = numpy.random.default_rng(0)
    scale = numpy.repeat([500.0, 30.0, 500.0, 1.0, 20.0], 3)
    best_n, failed = numpy.inf, 0
    began = time.perf_counter()
    for _ in range(restarts):
        try:
            found, _ = curve_fit(law, inputs, force, p0=scale * random.uniform(0.1, 1.0, 15), method="lm")
        except RuntimeError:
            # It did not converge within the default number of evaluations.
            failed += 1
            continue
        best_n = min(best_n, float(numpy.sqrt(numpy.mean((law(inputs, *found) - force) ** 2))))
    scipy_s = time.perf_counter() - began
    print(f"mr_damper {own_s:.3f} s, RMSE {own_n:.2f} N; scipy {scipy_s:.1f} s, RMSE {best_n:.2f} N, {failed} of {restarts} starts failed")
    print(f"ratio {scipy_s / own_s:.0f}, on {moving.sum()} samples")


if __name__ == "__main__":
    import warnings

    warnings.simplefilter("ignore", OptimizeWarning)
    main()
