#!/usr/bin/env python3
"""Compares the discovery of terms with an oracle, gradient boosting and SINDy, on the same residuals in the same run.

    tests/measured/discovery_peers.py [--program mr-damper] [--seeds 31 32] [--nulls 4] [--only ID] [--out FOLDER]

Needs numpy, scipy, scikit-learn 1.3 or later and pysindy 2 (pip install numpy scipy scikit-learn pysindy), and a built mr-damper.
Prints two Markdown tables. FOLDER keeps them, and all figures as JSON lines; a case that it already has is not repeated. A case takes
40 s on one core.

Runs. `mr-damper simulate` has the Bouc-Wen valve only. There `close --base fuzzy-tanh --fixed-base` says "base inadequate" and names
nothing. So this script contains the rig's quasi-static valve, on which the guide measures discovery with a fixed base: the equations
and constants of model/src/rig/{quasi_static,undeclared,signal,current,channel}.rs, with the excitation and the instruments of
model/examples/discovery_rates.rs and random numbers of its own. A case has a training, a validation and a test run, and a run of the
healthy damper, of 30 s at 512 Hz. The true force, before noise and quantisation, is known.

Methods. The base is `mr-damper identify --model fuzzy-tanh` on the training run. The peers correct the base with the effects that
`close --terms 0` finds (library only).
    ours      `mr-damper close --fixed-base --healthy` with its defaults: effects of the library, then up to three terms
    oracle    the force that the effect changes (the difference of the true forces with and without it) is subtracted before the base is
              identified, and added to its prediction
    boosting  HistGradientBoostingRegressor on the residual of the training run. The number of trees, their leaves and the target (the
              raw or the low-passed residual) have the least error on the validation run. Zero trees are allowed.
    SINDy     pysindy's STLSQ on every second row of the same residual, with the library of `Sindy`. Threshold, ridge and target have the
              least error on the validation run. The empty model is allowed.
Only ours has the healthy run. PySR needs Julia, which its installer could not download here, so it is not among the peers.

Inputs of the peers (`signals`): displacement, velocity, acceleration, current and simulated force, now and 10, 50 and 200 ms ago; time,
path and energy since the start; and the search's arguments with a short memory: time and travel since the last reversal, time since the
last change of current, mean speed. Their velocity and acceleration are Savitzky-Golay derivatives over 25 ms, which look 12 ms ahead;
ours has the causal parabola of `close`. The temperature is left out: the test run starts 24 K warmer than the training run.

Score. Share of the reducible squared error removed on the test run, (E_library - E_method) / (E_library - E_noise), without the mean of
the run, behind the low-pass of `close`, on the rows that it counts. E_noise is the error of the measured force against the true one.
The reducible error contains what the base lacks on the healthy damper, so a method can remove more than the oracle does.

`mr-damper` has no command that writes a prediction. The script therefore repeats the base and four simple effects in numpy, and compares
their error with the one that `close` prints: it stops where they differ by 0.1 %.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import tomllib
import warnings
from pathlib import Path

import numpy as np
from pysindy.optimizers import STLSQ
from scipy.signal import lfilter, savgol_filter
from sklearn.ensemble import HistGradientBoostingRegressor

RATE, SECONDS, SUB = 512, 30, 16
# Typical sizes of the rig (model/src/rig/inject.rs).
EFFECTS = {
    "seal_drag": 40.0,
    "stray_field": 10.0,
    "mount_resonance": 0.5,
    "bore_score": 0.2,
    "thixotropy": 0.7,
    "wall_slip": 0.3,
    "aeration": 0.15,
    "cavitation": 0.1,
    "seal_blowout": 0.15,
    "relief_valve": 0.3,
    "core_saturation": 0.5,
    "current_sensor_creep": 0.2,
}
SCALES = ["force", "force_in_extension", "force_in_compression", "sign_velocity", "drive_sign_velocity"]
CURRENT = ["force_per_drive", "force", "drive_sign_velocity", "sign_velocity"]
# Modulators and arguments with which an effect counts as found: as in discovery_rates.rs.
TRUTH = {
    "seal_drag": (["one", "sign_velocity", "velocity"], ["velocity", "speed"]),
    "stray_field": (["one", "drive"], ["drive"]),
    "mount_resonance": (["one"], ["force"]),
    "bore_score": (SCALES, ["displacement", "displacement_magnitude"]),
    "thixotropy": (SCALES, ["time_since_reversal", "travel", "mean_speed", "speed", "velocity"]),
    "wall_slip": (SCALES, ["speed", "velocity", "drive"]),
    "aeration": (SCALES, ["mean_speed", "speed"]),
    "cavitation": (SCALES[:3], ["travel", "time_since_reversal", "displacement", "displacement_sign_velocity"]),
    "seal_blowout": (SCALES, ["time", "path", "energy", "temperature_rise"]),
    "relief_valve": (["one", "force", "sign_velocity"], ["force"]),
    "core_saturation": (CURRENT, ["drive"]),
    "current_sensor_creep": (CURRENT, ["time"]),
}


# ---- The rig -------------------------------------------------------------------------------------------------------------------


def motion(rng):
    """Displacement and velocity of a road: span 35 mm, level below 3 Hz, band 8 Hz, actuator 15 Hz; SUB values a sample."""
    low, high, count = 0.2, 20.5, 100
    f = low + (high - low) / count * np.arange(count)
    amplitude = (f**2 + 3.0**2) ** (-2.1 / 4) / np.sqrt(1 + (f / 8.0) ** 4) / np.sqrt(1 + (f / 15.0) ** 4)
    phase = rng.uniform(0, 2 * np.pi, count)
    t = np.arange(RATE * SECONDS * SUB) / (RATE * SUB)
    x, v = np.zeros_like(t), np.zeros_like(t)
    for a, w, p in zip(amplitude, 2 * np.pi * f, phase):
        x += a * np.cos(w * t - p)
        v -= a * w * np.sin(w * t - p)
    u = np.minimum(np.minimum(t, t[-1] - t) / 0.5, 1.0)
    direction = np.where(t < t[-1] / 2, 1.0, -1.0)
    fade, slope = u**3 * (10 + u * (6 * u - 15)), direction * 30 * u**2 * (1 - u) ** 2 / 0.5
    x, v = fade * x, fade * v + slope * x
    scale = 0.035 / np.ptp(x)
    return t, scale * (x - x.mean()), scale * v


def current(rng):
    """The driver's current: an APRBS of 0 to 2.5 A (mean 1.2 A, deviation 1 A, mean hold 100 samples), with the driver's lag of 1 ms."""

    def draw():
        while True:
            value = rng.normal(1.2, 1.0)
            if 0.0 <= value <= 2.5:
                return value

    command, level = np.empty(RATE * SECONDS), draw()
    for k in range(len(command)):
        if k > 0 and rng.random() >= 0.99:
            level = draw()
        command[k] = level
    command = np.repeat(command, SUB)
    kept = np.exp(-1 / (RATE * SUB) / 1e-3)
    # The command of a sample acts from that sample on.
    return lfilter([0.0, 1 - kept], [1.0, -kept], command, zi=[command[0] * kept + command[0] * (1 - kept)])[0]


def true_force(t, x, v, driver, sizes):
    """Force of the quasi-static valve with the effects `sizes`, at every sub-step."""
    size = lambda name: sizes.get(name, 0.0)
    step = t[1]
    fluid = driver / (1 + size("current_sensor_creep") * np.mod(t / 7.0, 1.0))
    f = size("core_saturation")
    core = fluid / (1 + (f * fluid) ** 4) ** 0.25
    rise = core**2 / (core**2 + 2.0**2)
    yield_n, viscous = 80.0 + 1000.0 * rise, 600.0 + 2500.0 * rise
    yield_n = yield_n * (1 + size("thixotropy") * structure(v, step))
    yield_n *= 1 - size("wall_slip") / (1 + np.exp(-(np.abs(v) * fluid - 0.08) / 0.015))
    lean = 1 - size("bore_score") / (1 + ((x - 3e-3) / 2e-3) ** 4)
    force = lean * (yield_n * np.tanh(v / 0.03) + viscous * v)
    if size("aeration") > 0:
        force = force * (1 - size("aeration") * gas(v, step))
    force = np.where((force < 0) & (np.cumsum(np.abs(v)) * step > 0.5), force * (1 - size("seal_blowout")), force)
    added = size("seal_drag") * (np.abs(v) / 0.1) ** 0.4 * np.sign(v) + size("stray_field") * driver**2
    if size("cavitation") > 0:
        force = np.where(force < 0, force * 5e-4 / (5e-4 + void(v, force + added, size("cavitation"), step)), force)
    force = force - size("relief_valve") * np.maximum(np.abs(force) - 500.0, 0.0) * np.sign(force) + added
    if size("mount_resonance") > 0:
        force = force + size("mount_resonance") * (resonance(force, step) - force)
    return force


def structure(v, step):
    built, out = 1.0, np.empty_like(v)
    for k, speed in enumerate(np.abs(v).tolist()):
        out[k] = built
        built = (built + step / 0.3) / (1 + step / 0.3 + step * speed / 5e-3)
    return out


def gas(v, step):
    share, out = 0.0, np.empty_like(v)
    for k, mix in enumerate((step / 0.3 * np.abs(v / 0.1) ** 3).tolist()):
        out[k] = share
        share = (share + mix) / (1 + mix + step / 1.5)
    return out


def void(v, force, size, step):
    """Length of the void. It grows in extension only, where the force does not depend on it."""
    length, out = 0.0, np.empty_like(v)
    for k, (rate, newtons) in enumerate(zip(v.tolist(), force.tolist())):
        out[k] = length
        opens = rate > 0 and newtons > 300.0
        length = max(0.0, length + step * (size * rate if opens else min(rate, 0.0)))
    return out


def resonance(force, step):
    """The mount's response (32 Hz, damping 0.06), by Tustin's rule."""
    w, zeta, k = 2 * np.pi * 32.0, 0.06, 2 / step
    b = np.array([1.0, 2.0, 1.0]) * w * w
    a = np.array([k * k + 2 * zeta * w * k + w * w, 2 * (w * w - k * k), k * k - 2 * zeta * w * k + w * w])
    return lfilter(b / a[0], a / a[0], force)


class Rig:
    """One run: its channels as the instruments log them, and the true force with and without the effects."""

    def __init__(self, sizes, start_c, seed):
        rng = np.random.default_rng(seed)
        t, x, v = motion(rng)
        driver = current(rng)
        changed, plain = true_force(t, x, v, driver, sizes), true_force(t, x, v, driver, {})
        self.t, self.true, self.effect = t[::SUB], changed[::SUB], (changed - plain)[::SUB]
        count = len(self.t)
        heat = (changed * v + driver**2 - 0.0)[::SUB]
        kept, share = 1 - 1 / (80.0 * RATE), 1 / (80.0 * RATE)
        warm = lfilter([0.0, share], [1.0, -kept], heat + 23.0, zi=[start_c * kept + share * (heat[0] + 23.0)])[0]
        log = lambda values, noise, quantum: np.round((values + noise * rng.standard_normal(len(values))) / quantum) * quantum
        self.x = log(x[::SUB], 3e-6, 1e-6)
        self.i = log(driver[::SUB], 2e-3, 1e-4)
        self.force = log(self.true, 3.0, 0.5)
        self.case = log(warm, 0.1, 0.05)
        assert count == RATE * SECONDS

    def write(self, path, force=None):
        force = self.force if force is None else force
        with open(path, "w") as file:
            file.write("time_s,displacement_m,force_n,current_a,case_temp_c\n")
            for k, row in enumerate(zip(self.t.tolist(), self.x.tolist(), force.tolist(), self.i.tolist())):
                case = repr(float(self.case[k])) if k % 128 == 0 else ""
                file.write(",".join(map(repr, row)) + f",{case}\n")
        return str(path)


# ---- The base, as mr-damper computes it ----------------------------------------------------------------------------------------


def lag(values, tau_s):
    """First-order lag along the first axis, exact for values that are linear between samples; at rest at the first value."""
    ratio = 1 / (RATE * tau_s)
    p, q = np.exp(-ratio), -np.expm1(-ratio) / ratio
    return lfilter([1 - q, q - p], [1.0, -p], values, axis=0, zi=values[:1] * q)[0]


def low_pass(values):
    """The low-pass of `close`: two equal poles at 20 Hz."""
    tau_s = 1 / (2 * np.pi * 20.0)
    return lag(lag(values, tau_s), tau_s)


def inputs(run):
    """Displacement, velocity (parabola through three points) and current, from the second sample on."""
    d = np.diff(run.x) * RATE
    v = d.copy()
    v[1:] += np.diff(d) / 2
    return run.x[1:], v, run.i[1:]


def base_force(model, run):
    """Unfiltered force of a fuzzy-tanh model file."""
    p = model["parameters"]
    x, v, i = inputs(run)
    centres = np.array(p["membership_centres_a"])
    strength = -((i[:, None] - centres) ** 2) / (2 * p["membership_sigma_a"] ** 2)
    behind = strength.max(1, keepdims=True) - strength
    weights = np.where(behind > 16.11809565095832, 0.0, np.exp(-behind))
    weights /= weights.sum(1, keepdims=True)
    each = lambda name: np.array(p[name])
    u = v[:, None] + each("coupling_per_s") * x[:, None]
    forces = each("yield_force_n") * np.tanh(each("pre_yield_slope_s_m") * u) + each("post_yield_damping_n_s_m") * u
    return (weights * forces).sum(1) + p["force_offset_n"]


def with_effects(model, run):
    """Unfiltered force of a fuzzy-tanh model file with effects. Only the effects are here that the library finds in these runs."""
    x, v, _ = inputs(run)
    force, offset = base_force(model, run), model["parameters"]["force_offset_n"]
    for effect in model["effects"]:
        match effect["id"]:
            case "asymmetry":
                force = (force - offset) * (1 + effect["asymmetry"] * np.tanh(v / 5e-3)) + offset
            case "position_dependence":
                force = (force - offset) * (1 + effect["growth_per_m"] * x) + offset
            case "velocity_saturation":
                force = force + effect["quadratic_n_s2_m2"] * v * np.abs(v)
            case "inertia":
                force = force + effect["mass_kg"] * np.concatenate([[0.0], np.diff(v) * RATE])
            case "force_lag" if "tau_s" in effect:
                force = lag(force, effect["tau_s"])
            case "anti_alias_mismatch":
                force = lag(lag(force, effect["delay_s"] / 2), effect["delay_s"] / 2)
            case other:
                sys.exit(f"the effect {other} is not implemented in with_effects")
    return force


def counted(run):
    """Rows that `close` counts: the filter has settled (6.64 time constants) and the damper moves."""
    reach = int(0.01 * RATE)
    k = np.arange(1, len(run.x))
    first, last = np.maximum(k - reach, 1), np.minimum(k + reach, len(run.x) - 1)
    speed = np.abs(run.x[last] - run.x[first]) / ((last - first) / RATE)
    fast = np.flatnonzero(speed > 0.05 * speed.max())
    near = np.zeros(len(k), bool)
    margin = int(0.1 * RATE)
    for at in fast:
        near[max(at - margin, 0) : at + margin + 1] = True
    return near & ((k - 1) / RATE >= 6.64 / (2 * np.pi * 20.0)) & (k >= 3)


def power(error, rows):
    return float(np.var(error[rows]))


# ---- The peers ------------------------------------------------------------------------------------------------------------------


def lagged(values, seconds):
    by = round(seconds * RATE)
    return np.concatenate([np.full(by, values[0]), values[:-by]])


def since(marks):
    """Rows since the last mark."""
    k = np.arange(len(marks))
    return k - np.maximum.accumulate(np.where(marks, k, 0))


def signals(run, force):
    """Inputs of the peers by name; `force` is the unfiltered simulated force."""
    window = 13  # 25 ms
    derivative = lambda order: savgol_filter(run.x, window, 4, deriv=order, delta=1 / RATE)[1:]
    x, i, v, a = run.x[1:], run.i[1:], derivative(1), derivative(2)
    now = {"x": x, "v": v, "a": a, "i": i, "F": force}
    out = dict(now)
    for name, values in now.items():
        for ms in (10, 50, 200):
            out[f"{name}({ms} ms ago)"] = lagged(values, ms / 1000)
    out["t"] = run.t[1:]
    out["path"] = np.cumsum(np.abs(v)) / RATE
    out["energy"] = np.cumsum(np.abs(force * v)) / RATE
    reversed_ = np.concatenate([[True], np.sign(v[1:]) != np.sign(v[:-1])])
    rows = since(reversed_)
    out["time since reversal"] = rows / RATE
    out["travel"] = np.abs(x - x[np.arange(len(x)) - rows])
    out["time since current change"] = since(np.concatenate([[True], np.abs(np.diff(i)) > 0.03])) / RATE
    share = 1 - np.exp(-1 / (RATE * 0.5))
    out["mean speed"] = lfilter([share], [1.0, share - 1], np.abs(v))
    return out


class Problem:
    """What the peers see of a run: signals, residual of the library-only model, and rows."""

    def __init__(self, run, prediction):
        self.signals = signals(run, prediction)
        self.rows = counted(run)
        self.raw = run.force[1:] - prediction
        self.low = low_pass(self.raw)

    def error(self, correction, behind_filter):
        return power(self.low - (correction if behind_filter else low_pass(correction)), self.rows)


def table(problem, columns, behind_filter):
    values = columns(problem.signals)
    return low_pass(values) if behind_filter else values


TREES = (10, 20, 40, 80, 150, 300)


def boosting(train, confirm, test):
    """Test error, and the settings."""
    columns = lambda found: np.stack(list({**found, "sgn v": np.sign(found["v"])}.values()), 1)
    best = (confirm.error(np.zeros(len(confirm.raw)), False), np.zeros(len(test.raw)), False, "no tree")
    for behind_filter in (False, True):
        parts = [table(problem, columns, behind_filter) for problem in (train, confirm, test)]
        target = (train.low if behind_filter else train.raw)[train.rows]
        for rate, leaves, least in ((0.05, 31, 40), (0.05, 63, 200)):
            model = HistGradientBoostingRegressor(
                max_iter=TREES[-1], learning_rate=rate, max_leaf_nodes=leaves, min_samples_leaf=least, early_stopping=False, random_state=0
            )
            model.fit(parts[0][train.rows], target - target.mean())
            staged = list(model.staged_predict(parts[1]))
            for trees in TREES:
                error = confirm.error(staged[trees - 1], behind_filter)
                if error < best[0]:
                    settings = f"{trees} trees, rate {rate}, {leaves} leaves, {'low-passed' if behind_filter else 'raw'} target"
                    best = (error, (model, parts[2], trees), behind_filter, settings)
    found = best[1]
    if isinstance(found, tuple):
        model, part, trees = found
        found = next(value for k, value in enumerate(model.staged_predict(part), 1) if k == trees)
    return test.error(found, best[2]), best[3]


class Sindy:
    """The library of SINDy: products of up to three of the signals in `BASIC`; each further signal alone, and times sgn v, v and F.

    |v| is v sgn v; as a signal of its own it makes the columns collinear, and the models explode. Signals are clipped to their range in
    the training run, because products of three extrapolate badly; trees do that by themselves.
    """

    BASIC = ("x", "v", "sgn v", "a", "i", "F", "t")

    def __init__(self, found):
        self.ranges = {name: (values.min(), values.max()) for name, values in found.items()}
        self.scales = {name: max(float(np.abs(values).max()), 1e-12) for name, values in self.signals(found).items()}
        basic = self.BASIC
        names = [[name] for name in self.scales]
        names += [[a, b] for k, a in enumerate(basic) for b in basic[k:]]
        names += [[a, b, c] for k, a in enumerate(basic) for j, b in enumerate(basic[k:], k) for c in basic[j:]]
        names += [[name, by] for name in self.scales if name not in basic for by in ("sgn v", "v", "F")]
        self.names = [product for product in names if product.count("sgn v") < 2]

    def signals(self, found):
        clipped = {name: np.clip(values, *self.ranges[name]) for name, values in found.items()}
        return {**clipped, "sgn v": np.tanh(found["v"] / 0.01)}

    def __call__(self, found):
        scaled = {name: values / self.scales[name] for name, values in self.signals(found).items()}
        return np.stack([np.prod([scaled[name] for name in product], axis=0) for product in self.names], 1)


def sindy(train, confirm, test):
    """Test error, number of terms, the largest term by its deviation on the training run, and the settings."""
    library = Sindy(train.signals)
    best = (confirm.error(np.zeros(len(confirm.raw)), False), None, False, [], "empty")
    for behind_filter in (False, True):
        parts = [table(problem, library, behind_filter) for problem in (train, confirm, test)]
        target = (train.low if behind_filter else train.raw)[train.rows]
        part = parts[0][train.rows]
        mean, deviation = part.mean(0), part.std(0)
        kept = deviation > 1e-9
        scale = np.where(kept, deviation, 1.0)
        normal = [np.where(kept, (part - mean) / scale, 0.0) for part in parts]
        for ridge in (10.0, 300.0, 3000.0):
            # Thresholds in newtons of a term's deviation.
            for threshold in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0):
                # STLSQ's ridge is on the sum of squares.
                optimizer = STLSQ(threshold=threshold, alpha=ridge, max_iter=20)
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    optimizer.fit(normal[0][train.rows][::2], (target - target.mean())[::2, None])
                coefficients = np.ravel(optimizer.coef_)
                error = confirm.error(normal[1] @ coefficients, behind_filter)
                if error < best[0]:
                    order = [k for k in np.argsort(-np.abs(coefficients)) if coefficients[k] != 0.0]
                    terms = [library.names[k] for k in order]
                    settings = f"threshold {threshold} N, ridge {ridge}, {'low-passed' if behind_filter else 'raw'} target"
                    best = (error, normal[2] @ coefficients, behind_filter, terms, settings)
    found = np.zeros(len(test.raw)) if best[1] is None else best[1]
    return test.error(found, best[2]), best[3], best[4]


# ---- One case -------------------------------------------------------------------------------------------------------------------


class Case:
    def __init__(self, program, folder, effect, seed):
        self.program, self.folder = program, folder
        index = 1 + list(EFFECTS).index(effect) if effect in EFFECTS else 0
        sizes = {effect: EFFECTS[effect]} if effect in EFFECTS else {}
        self.runs = [Rig(sizes, start, [seed, index, which]) for which, start in enumerate((22.0, 34.0, 46.0))]
        self.healthy = Rig({}, 22.0, [seed, index, 3])
        self.files = [run.write(folder / f"{name}.csv") for run, name in zip(self.runs, ("train", "confirm", "test"))]
        self.healthy_file = self.healthy.write(folder / "healthy.csv")

    def call(self, *arguments):
        ended = subprocess.run([self.program, "--quiet", *arguments], cwd=self.folder, capture_output=True, text=True)
        if ended.returncode != 0:
            sys.exit(f"{self.program} {' '.join(arguments)}: exit code {ended.returncode}\n{ended.stderr[-2000:]}")

    def identify(self, train, name):
        self.call("identify", "--model", "fuzzy-tanh", "--filter", "output", "--velocity", "three-point", train, "--out", f"{name}.toml")
        return tomllib.loads((self.folder / f"{name}.toml").read_text())

    def close(self, *options):
        (self.folder / "close.toml").unlink(missing_ok=True)
        runs = ["--estimate", self.files[0], "--confirm", self.files[1], "--test", self.files[2]]
        self.call("close", "--base", "base.toml", "--fixed-base", *runs, "--out", "close.toml", "--json", "close.json", *options)
        return json.loads((self.folder / "close.json").read_text())

    def ours(self):
        return self.close("--healthy", self.healthy_file)

    def measure(self):
        test = self.runs[2]
        rows = counted(test)
        base = self.identify(self.files[0], "base")
        library = self.close("--terms", "0")
        written = self.folder / "close.toml"
        self.library_model = tomllib.loads(written.read_text()) if written.exists() else None
        full = self.ours()
        # With effects, `close` refits the base together with them, and writes both.
        with_library = self.library_model or base
        forces = [with_effects(with_library, run) for run in self.runs]
        e_base = power(low_pass(test.force[1:] - base_force(base, test)), rows)
        e_library = power(low_pass(test.force[1:] - forces[2]), rows)
        for name, error in {"before": e_base, "after": e_library}.items():
            printed = library["test"][name]
            if abs(error**0.5 / printed["rsse_n"] - 1) > 1e-3 or int(rows.sum()) != printed["samples"]:
                sys.exit(f"{name}: {error**0.5} N on {rows.sum()} rows, but close printed {printed}")
        e_ours = full["test"]["after"]["rsse_n"] ** 2
        e_noise = power(low_pass(test.force[1:] - test.true[1:]), rows)
        # Oracle.
        less = self.runs[0].write(self.folder / "oracle.csv", self.runs[0].force - self.runs[0].effect)
        oracle = self.identify(less, "oracle")
        e_oracle = power(low_pass(test.force[1:] - test.effect[1:] - base_force(oracle, test)), rows)
        problems = [Problem(run, force) for run, force in zip(self.runs, forces)]
        e_boosting, boosted = boosting(*problems)
        e_sindy, terms, sparse = sindy(*problems)
        return {
            "rmse_n": {
                "noise": e_noise**0.5, "base": e_base**0.5, "library": e_library**0.5, "ours": e_ours**0.5, "oracle": e_oracle**0.5,
                "boosting": e_boosting**0.5, "sindy": e_sindy**0.5,
            },
            "library": [effect["id"] for effect in library["effects"]],
            **said(full),
            "boosting": boosted,
            "sindy": {"terms": len(terms), "first": terms[:3], "settings": sparse},
        }  # fmt: skip


def is_right(effect, term):
    """True if the term, or a pair of its class, is of the effect, and the healthy run does not show it."""
    modulators, arguments = TRUTH[effect]
    pairs = [(term["modulator"], term["argument"])] + [tuple(pair) for pair in term["class"]]
    return term["claim"] != "structure" and any(m in modulators and q in arguments for m, q in pairs)


# Signals of SINDy's library, as modulators and arguments of terms.
NAMES = {
    "x": "displacement",
    "v": "velocity",
    "sgn v": "sign_velocity",
    "i": "drive",
    "F": "force",
    "t": "time",
    "time since reversal": "time_since_reversal",
    "mean speed": "mean_speed",
}


def is_right_product(effect, product):
    """True if a product of SINDy's library is a modulator of the effect times a power of its argument."""
    modulators, arguments = TRUTH[effect]
    names = [NAMES.get(name, name) for name in product]
    speed = [name for name in names if name not in ("velocity", "sign_velocity")] + ["speed"]
    if names.count("velocity") == names.count("sign_velocity") == 1 and is_right_pair(speed, modulators, arguments):
        return True
    return is_right_pair(names, modulators, arguments)


def is_right_pair(names, modulators, arguments):
    for argument in set(names) & set(arguments):
        rest = sorted(name for name in names if name != argument)
        again = [argument] if names.count(argument) > 1 else []
        known = {"drive sign_velocity": "drive_sign_velocity"}
        for others in (rest, rest + again):
            text = " ".join(others) or "one"
            if known.get(text, text) in modulators:
                return True
    return False


def shares(result):
    power_of = {name: rmse**2 for name, rmse in result["rmse_n"].items()}
    reducible = power_of["library"] - power_of["noise"]
    return {name: (power_of["library"] - power_of[name]) / reducible for name in METHODS}


METHODS = ("ours", "oracle", "boosting", "sindy")


def report(results):
    """The tables. An effect is named by ours if a term that is not called structure is of the effect, and by SINDy if one of its three
    largest terms is; boosting names nothing."""
    lines = [
        "| effect | library-only, oracle: RMSE, N | ours | oracle | boosting | SINDy | named by ours | by SINDy; its number of terms |",
        "|---|---|---|---|---|---|---|---|",
    ]
    everything, named = [], [0, 0]
    for effect in EFFECTS:
        cases = [result for result in results if result["effect"] == effect]
        if not cases:
            continue
        each = [shares(case) for case in cases]
        everything += each
        rmse = [statistics.median(case["rmse_n"][name] for case in cases) for name in ("library", "oracle")]
        cells = " | ".join(f"{statistics.median(share[name] for share in each):.2f}" for name in METHODS)
        ours = sum(any(is_right(effect, term) for term in case["terms"]) for case in cases)
        sparse = sum(any(is_right_product(effect, product) for product in case["sindy"]["first"]) for case in cases)
        named = [named[0] + ours, named[1] + sparse]
        counts = ", ".join(str(case["sindy"]["terms"]) for case in cases)
        of = f"of {len(cases)}"
        lines.append(f"| {effect} | {rmse[0]:.1f}, {rmse[1]:.1f} | {cells} | {ours} {of} | {sparse} {of}; {counts} |")
    if everything:
        for title, function in (("median", statistics.median), ("least", min)):
            cells = " | ".join(f"{function([share[name] for share in everything]):.2f}" for name in METHODS)
            of = f"of {len(everything)}"
            last = f"{named[0]} {of} | {named[1]} {of}" if title == "median" else "|"
            lines.append(f"| {title} {of} cases | | {cells} | {last} |")
    nulls = [result for result in results if result["effect"] == "null"]
    if nulls:
        lines += ["", f"| {len(nulls)} cases without an effect | ours | oracle | boosting | SINDy |", "|---|---|---|---|---|"]
        worse = [sum(case["rmse_n"][name] > case["rmse_n"]["library"] * (1 + 1e-9) for case in nulls) for name in METHODS]
        lines.append("| test error made worse | " + " | ".join(map(str, worse)) + " |")
        left = [statistics.median((case["rmse_n"][name] / case["rmse_n"]["library"]) ** 2 for case in nulls) for name in METHODS]
        lines.append("| squared error left, median | " + " | ".join(f"{100 * ratio:.0f} %" for ratio in left) + " |")
        called = sum(any(term["claim"] == "effect" for term in case["terms"]) for case in nulls)
        lines.append(f"| a term called an effect | {called} | | | |")
    return "\n".join(lines)


def said(full):
    """What `close` with terms found."""
    keys = ("modulator", "argument", "equation", "claim", "class")
    return {
        "library_with_terms": [effect["id"] for effect in full["effects"]],
        "verdict": full["verdict"],
        "terms": [{key: term[key] for key in keys} for term in full["terms"]],
    }


def again(program, result):
    """`result` with our part measured again."""
    with tempfile.TemporaryDirectory() as folder:
        case = Case(program, Path(folder), result["effect"], result["seed"])
        case.identify(case.files[0], "base")
        full = case.ours()
    return {**result, **said(full), "rmse_n": {**result["rmse_n"], "ours": full["test"]["after"]["rsse_n"]}}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="mr-damper", help="path of mr-damper")
    parser.add_argument("--seeds", type=int, nargs="+", default=[31, 32], help="one case of each effect for each seed")
    parser.add_argument("--nulls", type=int, default=4, help="number of cases without an effect, with seeds from the first on")
    parser.add_argument("--only", default="", help="cases whose effect contains this text; 'null' for those without")
    parser.add_argument("--out", type=Path, help="folder for the tables and all figures; cases in it are not repeated")
    parser.add_argument("--again", action="store_true", help="measures our part of the cases in --out again, with another program")
    args = parser.parse_args()
    program = str(Path(args.program).resolve()) if "/" in args.program else args.program
    cases = [("null", args.seeds[0] + k) for k in range(args.nulls)]
    cases += [(effect, seed) for seed in args.seeds for effect in EFFECTS]
    results = []
    if args.out and (args.out / "cases.jsonl").exists():
        results = [json.loads(line) for line in (args.out / "cases.jsonl").read_text().splitlines()]
    if args.again:
        results = [again(program, result) for result in results]
        (args.out / "cases.jsonl").write_text("".join(json.dumps(each) + "\n" for each in results))
        (args.out / "table.md").write_text(report(results) + "\n")
    done = {(result["effect"], result["seed"]) for result in results}
    for effect, seed in cases:
        if args.only not in effect or (effect, seed) in done:
            continue
        with tempfile.TemporaryDirectory() as folder:
            result = {"effect": effect, "seed": seed, **Case(program, Path(folder), effect, seed).measure()}
        results.append(result)
        share = " ".join(f"{name} {value:.2f}" for name, value in shares(result).items())
        first = result["terms"][0]["equation"] if result["terms"] else "no term"
        print(f"{effect} {seed}: {share}; library {result['library']}; {first}", file=sys.stderr, flush=True)
        if args.out:
            args.out.mkdir(parents=True, exist_ok=True)
            (args.out / "cases.jsonl").write_text("".join(json.dumps(each) + "\n" for each in results))
            (args.out / "table.md").write_text(report(results) + "\n")
    print(report(results))


if __name__ == "__main__":
    main()
