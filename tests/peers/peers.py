"""Times Python tools on one identification problem, and writes the problem to files for our program.

usage: peers.py OUT_DIR EPOCHS

Writes OUT_DIR/train.csv and OUT_DIR/test.csv (30 s at 512 Hz each: a random road, a random current that is held for an eighth of a
second, a tanh damper with a coil lag, 2 lbf of noise; displacement and force pass the same low-pass filter), and OUT_DIR/peers.toml
with time and error of each peer. Errors are on test.csv, in simulation (free run), except for ARX, which predicts one step ahead.
"""

import sys
import time
import warnings
from pathlib import Path

import numpy as np
from anfis_toolbox import ANFISRegressor
from scipy.optimize import least_squares
from scipy.signal import butter, lfilter

RATE_HZ = 512
SAMPLES = 30 * RATE_HZ
RESTARTS = 25


def make(seed):
    """Displacement, velocity, current and force of one run, in SI units."""
    random = np.random.default_rng(seed)
    t = np.arange(SAMPLES) / RATE_HZ
    tones = np.linspace(0.5, 15.0, 120) * 2 * np.pi
    phases = random.uniform(0, 2 * np.pi, tones.size)
    x = (np.sin(np.outer(t, tones) + phases) / tones).sum(axis=1)
    x *= 0.0127 / np.abs(x).max()
    current = np.repeat(random.uniform(0, 2.5, SAMPLES // 64), 64)
    v = np.gradient(x, 1 / RATE_HZ)
    share = 1 - np.exp(-1 / (RATE_HZ * 0.008))
    effective = lfilter([share], [1, share - 1], current)
    u = v + (2.0 + 0.8 * effective) * x
    force = (876 + 525 * effective) * v + 1750 * x + (178 + 400 * effective) * np.tanh(17.7 * u)
    force += random.normal(0, 2 * 4.448, SAMPLES)
    b, a = butter(2, 20, fs=RATE_HZ)
    x, force = lfilter(b, a, x), lfilter(b, a, force)
    return t, x, np.gradient(x, 1 / RATE_HZ), current, force - force.mean()


def esr(force, predicted):
    return float(np.sum((force - predicted) ** 2) / np.sum((force - force.mean()) ** 2))


def write(path, run):
    header = "time_s,displacement_m,velocity_m_s,current_a,force_n"
    np.savetxt(path, np.stack(run, axis=1), delimiter=",", header=header, comments="", fmt="%.17g")


def lags(run):
    _, x, v, current, force = run
    k = np.arange(3, force.size)
    columns = [force[k - 1], force[k - 2], force[k - 3]]
    for signal in (x, v, current):
        columns += [signal[k], signal[k - 1], signal[k - 2]]
    return np.stack(columns, axis=1), force[k]


def arx(train, test):
    def fit():
        return np.linalg.lstsq(*lags(train), rcond=None)[0]

    seconds = min(timed(fit)[0] for _ in range(20))
    rows, force = lags(test)
    return {"seconds": seconds, "esr": esr(force, rows @ fit())}


def sp_force(p, run):
    """The semi-phenomenological model of the thesis: five quadratics in the current, 15 coefficients."""
    _, x, v, current, _ = run
    a1, a2, a3, v0, x0 = (p[3 * j] + p[3 * j + 1] * current + p[3 * j + 2] * current**2 for j in range(5))
    u = v + v0 / x0 * x
    return a1 * np.tanh(a3 * u) + a2 * u


def sp(train, test):
    random = np.random.default_rng(0)
    force = train[4]
    sizes = np.repeat([force.std(), force.std() / train[2].std(), 1 / train[2].std(), train[2].std(), 0.01], 3)
    sizes /= np.tile([1.0, 2.0, 8.0], 5)

    def fit():
        best, evaluations = None, 0
        for _ in range(RESTARTS):
            start = sizes * random.uniform(0.2, 1.5, 15) * np.tile([1.0, 0.3, 0.1], 5)
            found = least_squares(
                lambda p: sp_force(p, train) - force, start, method="lm", x_scale=sizes, max_nfev=3000
            )
            evaluations += found.nfev
            if best is None or found.cost < best.cost:
                best = found
        return best, evaluations

    seconds, (best, evaluations) = timed(fit)
    print(f"scipy: {evaluations} evaluations", file=sys.stderr)
    return {"seconds": seconds, "esr": esr(test[4], sp_force(best.x, test))}


def anfis(train, test, epochs):
    def inputs(run):
        return np.stack(run[1:4], axis=1)

    mean, deviation = inputs(train).mean(axis=0), inputs(train).std(axis=0)
    scale = train[4].std()
    # The default learning rate diverges on this problem.
    model = ANFISRegressor(
        n_mfs=3, mf_type="gaussian", optimizer="hybrid", epochs=epochs, learning_rate=1e-4, random_state=0
    )
    seconds, _ = timed(lambda: model.fit((inputs(train) - mean) / deviation, train[4] / scale))
    predicted = np.asarray(model.predict((inputs(test) - mean) / deviation)).ravel() * scale
    return {"seconds": seconds, "esr": esr(test[4], predicted)}


def timed(work):
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def main():
    out, epochs = Path(sys.argv[1]), int(sys.argv[2])
    warnings.filterwarnings("ignore")
    train, test = make(0), make(1)
    write(out / "train.csv", train)
    write(out / "test.csv", test)
    results = {"arx": arx(train, test)}
    print("numpy: ARX done", file=sys.stderr)
    results["sp"] = sp(train, test)
    print("scipy: tanh done", file=sys.stderr)
    results["anfis"] = anfis(train, test, epochs)
    lines = (f"{name} = {{ seconds = {r['seconds']}, esr = {r['esr']} }}" for name, r in results.items())
    (out / "peers.toml").write_text("\n".join(lines) + "\n")


main()
