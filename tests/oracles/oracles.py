"""Computes with numpy, scipy and scikit-fuzzy what the models of the thesis must give, and prints one list of numbers a line.

usage: oracles.py >model/tests/oracles/numbers.txt

Needs the packages of requirements.txt, and about half a minute. The tests that read numbers.txt make the same inputs by the same
formulas. Every part is written from the equation of the publication, without our code:

- gradients by complex steps, so that no derivative is written out;
- recursive least squares by the plain covariance recursion, batch fits by numpy.linalg.lstsq;
- optima by scipy.optimize.differential_evolution over the nonlinear parameters, with all others solved for by least squares.
"""

import numpy as np
import skfuzzy
from scipy.optimize import differential_evolution


def show(name, values, digits=15):
    print(name, *(f"{value:.{digits}g}" for value in np.ravel(values)))


# Motion and current of the fits: 2000 samples at 250 Hz.
PERIOD_S = 0.004
TONES = [(0.008, 5.0, 0.3), (0.003, 13.1, 1.1), (0.0012, 31.3, 2.0)]


def motion(count):
    t = PERIOD_S * np.arange(count)
    x = sum(a * np.sin(w * t + p) for a, w, p in TONES)
    v = sum(a * w * np.cos(w * t + p) for a, w, p in TONES)
    return t, x, v, 1.2 + 0.8 * np.sin(1.7 * t + 0.4) + 0.3 * np.sin(4.3 * t)


# Ahn et al.: gradient descent on triangular sets with constant conclusions.


def triangles(u, peaks):
    """Memberships of a partition whose outermost sets are shoulders; `peaks` may be complex."""
    place = np.clip(np.searchsorted(peaks.real, u, side="right") - 1, 0, len(peaks) - 2)
    share = (u - peaks[place]) / (peaks[place + 1] - peaks[place])
    weights = np.zeros((len(u), len(peaks)), dtype=complex)
    weights[np.arange(len(u)), place] = 1 - share
    weights[np.arange(len(u)), place + 1] = share
    return weights


def peaks_of(gaps):
    """Peaks over -1 to 1. `gaps` are the logarithms of the gaps relative to the first."""
    gaps = np.concatenate([[1.0], np.exp(gaps)])
    return np.concatenate([[-1.0], -1 + 2 * np.cumsum(gaps) / gaps.sum()])


def back_propagation():
    sets, epochs = [5, 4], 40
    runs = []
    for r, count in enumerate([60, 40]):
        k = np.arange(count)
        # No row lies on a peak, where the derivative has two values.
        u = np.stack([np.sin(0.7 * k + r + 0.1), np.cos(1.3 * k + 2 * r + 0.2)])
        target = np.tanh(2 * u[0]) + 0.5 * u[1] * u[0]
        runs.append((u, target - target.mean()))
    sizes = [sets[0] - 2, sets[1] - 2, sets[0] * sets[1], 2]
    cuts = np.cumsum(sizes)[:-1]

    def errors(p):
        gaps_1, gaps_2, conclusions, offsets = np.split(p, cuts)
        for (u, target), offset in zip(runs, offsets):
            w1, w2 = triangles(u[0], peaks_of(gaps_1)), triangles(u[1], peaks_of(gaps_2))
            weights = (w1[:, :, None] * w2[:, None, :]).reshape(len(target), -1)
            yield offset + weights @ conclusions / weights.sum(axis=1) - target

    def cost(p):
        e = np.concatenate(list(errors(p)))
        return (e * e).sum() / (2 * len(e))

    def lowest(p):
        return sum(((e - e.mean()) ** 2).sum().real for e in errors(p))

    p = np.zeros(sum(sizes))
    best, costs = None, []
    for epoch in range(epochs):
        # z = 1, so that 1 + largest |z|^2 = 2.
        step = 1.0 * (1 - epoch / epochs) / 2
        gradient = np.array([cost(p + 1e-30j * one).imag / 1e-30 for one in np.eye(len(p))])
        shares = np.concatenate([np.full(cuts[1], 0.1), np.ones(len(p) - cuts[1])])
        p = p - step * shares * gradient
        error = lowest(p)
        if not costs or error < min(costs):
            best = p
        costs.append(error)
    for name, values in zip(["memberships", "conclusions", "offsets"], np.split(best, cuts[1:])):
        show(f"back_propagation.{name}", values)
    show("back_propagation.errors", np.minimum.accumulate(costs))


# Recursive least squares: the plain covariance recursion.


def recursion():
    k = np.arange(1, 301)
    phi = np.stack([np.sin(0.3 * k), np.cos(0.71 * k), np.sin(1.7 * k + 1), np.ones(300)], axis=1)
    y = phi @ [2.0, -3.0, 0.5, 7.0] + 0.2 * np.sin(11 * k) - 30.0 * (k > 150)
    for forgetting in [1.0, 0.98]:
        a, p = np.zeros(4), 1e6 * np.eye(4)
        for j, (row, output) in enumerate(zip(phi, y)):
            if j == 150:
                # Another run, with a constant of its own.
                a[3], p[3, :], p[:, 3], p[3, 3] = 0.0, 0.0, 0.0, 1e6
            gain = p @ row / (forgetting + row @ p @ row)
            a = a + gain * (output - row @ a)
            p = (p - np.outer(gain, row @ p)) / forgetting
            p = (p + p.T) / 2
        show(f"recursion.{forgetting:g}", a)


# ARX with inputs from k-1, equation 5 of the first paper, by batch and by recursive least squares.


def narx():
    k = np.arange(3000)
    # Signals that are not derivatives of each other determine each coefficient.
    x, v = 0.008 * np.sin(0.013 * k * k), 0.15 * np.cos(0.11 * k * k)
    i, noise = 1.2 + np.sin(0.0007 * k * k), 3 * np.sin(0.9 * k * k)
    force = np.zeros(3000)
    truth = [1.3, -0.5, 0.1, 4000, -6000, 2500, 300, 150, -80, 30, -12, 5]
    row = lambda k: np.concatenate([s[[k - 1, k - 2, k - 3]] for s in (force, x, v, i)])
    for k in range(3, 3000):
        force[k] = row(k) @ truth + 12 + noise[k]
    # The first sample has no velocity in a recorded run, so that no row uses it.
    rows = np.array([np.append(row(k), 1) for k in range(4, 3000)])
    solved, *_ = np.linalg.lstsq(rows, force[4:], rcond=None)
    show("narx.coefficients", solved[:12])
    predicted = np.array([np.append(row(k), 1) for k in range(3, 3000)]) @ solved
    show("narx.rmse_n", np.sqrt(np.mean((predicted - force[3:]) ** 2)))
    show("narx.offset_n", solved[12] / (1 - solved[:3].sum()))


# Kwok et al.: the best fit of the law to a damper that it does not describe.


def kwok():
    t, x, v, i = motion(2000)
    sign = np.where(x > 0, 1.0, -1.0)
    for name, drive in [("passive", 1.0 + 0 * i), ("linear", i)]:
        force = (300 + 400 * drive) * np.arctan(25 * (v + 1.5 * x)) * 2 / np.pi + (500 + 200 * drive) * v + 12
        powers = [1 + 0 * i] if name == "passive" else [1 + 0 * i, drive]

        def fit(p):
            half = len(powers)
            beta, delta = (sum(c * q for c, q in zip(part, powers)) for part in (p[:half], p[half:]))
            z = np.tanh(beta * v + delta * sign)
            columns = np.stack([c * q for q in powers for c in (v, x, z)] + [1 + 0 * v], axis=1)
            solved, *_ = np.linalg.lstsq(columns, force, rcond=None)
            return np.sqrt(np.mean((columns @ solved - force) ** 2))

        bounds = [(1, 200), (-3, 3)] if name == "passive" else [(1, 200), (-60, 60), (-3, 3), (-2, 2)]
        found = differential_evolution(fit, bounds, seed=1, tol=1e-8)
        show(f"kwok.{name}.rmse_n", found.fun, 7)

        # The swarm of Shi and Eberhart over all parameters at once, from the ranges of the model, with five seeds.
        def error(p):
            c, k, alpha, beta, delta = sum(q * part[:, None] for q, part in zip(powers, p.reshape(-1, 5)))
            return (force - (c * v + k * x + alpha * np.tanh(beta * v + delta * sign))).std()

        size, speed, stroke = np.ptp(force) / 2, np.abs(v).max(), np.ptp(x) / 2
        units = np.array([size / speed, size / stroke, size, 1 / speed, 1.0])
        ranges = units[:, None] * [(0, 1), (-0.2, 0.2), (0.3, 1), (1, 100), (-2, 2)]
        if name == "linear":
            width = np.ptp(ranges, axis=1) / np.abs(drive).max()
            ranges = np.vstack([ranges, np.stack([-width, width], axis=1)])
        show(f"kwok.{name}.swarms_rmse_n", sorted(swarm(error, ranges, seed) for seed in range(5)), 7)


def swarm(error, ranges, seed, particles=32, generations=200):
    random, width = np.random.default_rng(seed), np.ptp(ranges, axis=1)
    p = ranges[:, 0] + width * random.random((particles, len(ranges)))
    u, own, lowest = 0 * p, p.copy(), np.full(particles, np.inf)
    for generation in range(generations + 1):
        costs = np.array([error(one) for one in p])
        own[costs < lowest], lowest = p[costs < lowest], np.minimum(costs, lowest)
        inertia = 0.9 - 0.5 * generation / generations
        pull = random.random(p.shape) * (own - p) + random.random(p.shape) * (own[lowest.argmin()] - p)
        u = np.clip(inertia * u + 2 * pull, -0.2 * width, 0.2 * width)
        p = p + u
    return lowest.min()


# Du and Zhang: the best Gaussian sets of a first-order TSK model over displacement and velocity.


def du_zhang():
    """Root of the least mean of (F - F_mean - linear - rules)^2 / var F + lambda |conclusions|^2: `linear` is the linear fit of the inputs,
    and lambda fifteen times the same mean of the uniform grid with a lambda of 1e-10 (node/docs/guide/models.md)."""
    count = 500
    t, x, v, _ = motion(count)
    force = 700 * np.tanh(50 * (v + 4 * x)) + 900 * v + 4000 * x + 400 * np.sin(500 * x) + 20 * np.sin(97 * t)
    axes = [(s - s.mean()) / s.std() for s in (x, v)]
    scale = force.std()
    inputs = np.stack(axes, axis=1)
    target = (force - force.mean()) / scale
    target = target - inputs @ np.linalg.lstsq(inputs, target, rcond=None)[0]

    def cost(p, ridge):
        weights = []
        for u, own in zip(axes, p.reshape(2, 3, 2)):
            weights.append(np.exp(-0.5 * ((u[:, None] - own[:, 0]) / np.exp(own[:, 1])) ** 2))
        fired = (weights[0][:, :, None] * weights[1][:, None, :]).reshape(count, 9)
        fired /= fired.sum(axis=1, keepdims=True)
        z = np.column_stack([inputs, np.ones(count)])
        columns = (fired[:, :, None] * z[:, None, :]).reshape(count, 27)
        columns = columns - columns.mean(axis=0)
        # The ridge as further rows.
        rows = np.vstack([columns, np.sqrt(ridge * count) * np.eye(27)])
        right = np.append(target, np.zeros(27))
        solved, *_ = np.linalg.lstsq(rows, right, rcond=None)
        return np.sum((rows @ solved - right) ** 2) / count

    grid, bounds = [], []
    for u in axes:
        spacing = (u.max() - u.min()) / 2
        for j in range(3):
            centre, width = u.min() + spacing * j, np.log(spacing / (2 * np.sqrt(2 * np.log(2))))
            grid += [centre, width]
            bounds += [(centre - spacing / 2, centre + spacing / 2), (width - np.log(2), width + np.log(2))]
    ridge = 15 * cost(np.array(grid), 1e-10) / count
    show("du_zhang.grid_n", scale * np.sqrt(cost(np.array(grid), ridge)), 10)
    found = differential_evolution(cost, bounds, args=(ridge,), seed=1, maxiter=120, popsize=6, tol=1e-9, polish=False)
    show("du_zhang.optimum_n", scale * np.sqrt(found.fun), 7)
    found = [genetic(lambda p: cost(p, ridge), np.array(bounds), seed) for seed in range(12)]
    show("du_zhang.genetic_n", scale * np.sqrt(sorted(found)), 7)
    show("du_zhang.ridge", ridge)


def genetic(cost, bounds, seed, size=24, generations=40):
    """Tournaments of three, BLX-0.5 with probability 0.9, mutations of a tenth of the range, elitism. One individual starts in the middle of
    the bounds."""
    random, (low, high) = np.random.default_rng(seed), bounds.T
    population = low + (high - low) * random.random((size, len(low)))
    population[0] = (low + high) / 2
    costs = np.array([cost(p) for p in population])
    for _ in range(generations):
        children = []
        for _ in range(size):
            p, q = (population[min(random.integers(0, size, 3), key=lambda k: costs[k])] for _ in range(2))
            child = p + (2 * random.random(len(low)) - 0.5) * (q - p) if random.random() < 0.9 else p.copy()
            mutated = random.random(len(low)) < 1 / len(low)
            child += mutated * 0.1 * (high - low) * random.standard_normal(len(low))
            children.append(np.clip(child, low, high))
        new = np.array([cost(child) for child in children])
        children[new.argmax()], new[new.argmax()] = population[costs.argmin()], costs.min()
        population, costs = np.array(children), new
    return costs.min()


# Laws of the review, linear in the current as printed.


def laws():
    points = [(0.004, 0.13, 2.0, 0.4), (-0.007, -0.05, -3.0, 1.7), (0.002, 0.21, -1.0, 2.5), (-0.001, -0.3, 4.0, 0.0)]

    def of(law, constant, slope):
        return [law([a + b * i for a, b in zip(constant, slope)], x, v, acc) for x, v, acc, i in points]

    def kwok_law(p, x, v, acc):
        c, k, alpha, beta, delta = p
        return c * v + k * x + alpha * np.tanh(beta * v + delta * np.sign(x))

    def li(p, x, v, acc):
        height, steepness, hysteresis, slope, stiffness = p[:5] if acc >= 0 else p[5:]
        e = np.exp(-steepness * (v - hysteresis))
        return height * (1 - e) / (1 + e) + slope * v + stiffness * x

    def choi(p, x, v, acc):
        return np.polyval((p[:7] if acc >= 0 else p[7:])[::-1], v)

    kwok_numbers = [[600, 1500, 250, 40, 0.5], [400, -500, 500, 8, 0.2]]
    li_numbers = [
        [150, 60, 0.02, 700, 900, 180, 50, -0.03, 650, 1100],
        [300, -8, 0.01, 90, -200, 280, -6, -0.01, 120, -300],
    ]
    sequence = lambda k: np.array([100 * (-1.7) ** j * np.sin(1 + j + k) for j in range(7)])
    choi_numbers = [np.concatenate([sequence(0), sequence(5)]), np.concatenate([sequence(2), sequence(9)])]
    for name, law, numbers in [("kwok", kwok_law, kwok_numbers), ("li", li, li_numbers), ("choi", choi, choi_numbers)]:
        show(f"laws.{name}", of(law, *numbers))


# Membership functions of scikit-fuzzy, and the weighted average of a Sugeno system with them.


def memberships():
    u = np.linspace(-3, 3, 25)
    systems = {
        "gbellmf": [skfuzzy.gbellmf(u, *p) for p in [(1, 2, -2), (1.5, 0.7, 0), (1, 4.5, 2)]],
        "gaussmf": [skfuzzy.gaussmf(u, c, s) for s, c in [(0.9, -2), (0.5, 0.5), (1.2, 2)]],
        "trimf": [skfuzzy.trimf(u, p) for p in [(-4, -2, 0.5), (-3.5, 0, 1.5), (-1, 2, 4)]],
        "trapmf": [skfuzzy.trapmf(u, p) for p in [(-4, -3, -1.5, 0), (-2, 0, 0, 1.5), (0.5, 2, 3, 4)]],
        "gauss2mf": [skfuzzy.gauss2mf(u, c1, s1, c2, s2) for s1, c1, s2, c2 in [(0.5, -2, 0.8, -1), (0.7, 0, 0.4, 0.5), (1, 2, 0.3, 2)]],
    }
    for name, sets in systems.items():
        weights = np.array(sets)
        show(f"memberships.{name}", np.array([1.0, 2.0, 3.0]) @ weights / weights.sum(axis=0))


# Networks and rules from the numbers of a model file.


def weight(neuron, signal):
    return 0.3 * np.sin((1 + signal) * 0.7 + neuron * 0.31)


def lagged(signals):
    """Signals with their numbers of lags and first lag, at sample k, newest first."""
    return lambda k: np.concatenate([s[k - first - np.arange(lags)] for s, lags, first in signals])


def network(u, hidden, gain=None):
    """The sum of a network's output layer for normalised inputs `u`."""
    if gain is not None:
        n = np.arange(len(u))
        u = np.tanh((0.8 + 0.1 * np.cos(n)) * u + 0.05 * np.sin(2.0 * n))
    j, n = np.arange(hidden), np.arange(len(u))
    h = np.tanh(weight(j[:, None], n[None, :]) @ u + 0.05 * j - 0.4)
    return 0.2 * np.cos(j) @ h + 0.15


def files():
    k = np.arange(40)
    x, v, acc = 0.004 * np.sin(0.05 * k), 0.1 * np.cos(0.05 * k), -3.0 * np.sin(0.05 * k)
    force, current = 300 * np.cos(0.07 * k), 1.0 + 0.8 * np.sin(0.3 * k)
    xn, vn, fn, cn = (x - 0.001) / 0.003, (v + 0.01) / 0.08, (force - 20) / 250, (current - 0.9) / 0.6
    for name, lags, past, hidden in [("chen", 2, 1, 25), ("wang-liao", 5, 5, 15)]:
        u = lagged([(xn, lags, 0), (vn, lags, 0), (fn, lags, 0), (cn, past, 1)])
        show(f"files.inverse.{name}", [0.9 + 0.6 * network(u(k), hidden) for k in range(8, 40, 4)])
        # The direct network: the force is fed back, the current is an input.
        u = lagged([(xn, lags, 0), (vn, lags, 0), (cn, lags, 0), (fn, past, 1)])
        gain = True if name == "wang-liao" else None
        show(f"files.direct.{name}", [20 + 250 * network(u(k), hidden, gain) for k in range(8, 40, 4)])
    centres, sigmas = np.array([-1.2, 0.1, 1.4]), np.array([0.5, 0.7, 0.6])
    conclusions = np.sin(0.37 * np.arange(108)).reshape(3, 3, 3, 4)
    outputs = []
    for at in range(8, 40, 4):
        u = np.array([(v[at] - 0.01) / 0.1, (acc[at] + 0.5) / 4.0, (force[at] - 15) / 400])
        g = np.exp(-(((u[:, None] - centres) / sigmas) ** 2) / 2)
        fired = np.einsum("i,j,k->ijk", *g)
        outputs.append(0.8 + 0.5 * (fired * (conclusions @ np.append(u, 1))).sum() / fired.sum())
    show("files.inverse.wang-hu", outputs)


# Boada et al.: the rule of the live memory, by brute force; and the local regression by leaving points out.


def boada():
    count, r = 40, lambda k, step: (k * step) % 1.0
    j = np.arange(count)
    points = np.stack([2 * r(j, 0.819172513) - 1, 2 * r(j, 0.671043607) - 1, 2 * r(j, 0.549700477) - 1], axis=1)
    scales = np.array([0.5, 0.3, 0.8])
    held = 100 * np.sin(3 * points[:, 0]) + 80 * points[:, 1] + 50 * points[:, 2]
    origin, age = [-1] * count, [0] * count
    distance = lambda a, b: np.sqrt((((a - b) / scales) ** 2).sum(axis=-1))
    nearest = lambda j: np.delete(distance(points, points[j]), j).min()
    spacing = np.mean([nearest(j) for j in range(count)])
    last, learned = None, 0
    for k in range(400):
        q = np.array([0.9 * np.sin(0.37 * k), 0.7 * np.cos(0.91 * k), np.sin(0.053 * k)])
        force = 60 * np.sin(3 * q[0]) + 90 * q[1] + 40 * q[2]
        if last is not None and distance(q, last) < spacing:
            continue
        near = distance(points, q)
        if near.min() < spacing:
            replaced = near.argmin()
        else:
            one = min(range(count), key=nearest)
            others = [o for o in range(count) if o != one]
            other = min(others, key=lambda o: distance(points[o], points[one]))
            replaced = other if age[other] < age[one] else one
        learned += 1
        points[replaced], held[replaced], origin[replaced], age[replaced], last = q, force, k, learned, q
    show("boada.origin", origin)

    def local(q):
        order = np.argsort(distance(points, q), kind="stable")[:12]
        z, f = np.column_stack([np.ones(12), (points[order] - q) / scales]), held[order]
        base = f[0]

        def solve(rows):
            a, b = z[rows], f[rows] - base
            return np.linalg.solve(a.T @ a + 1e-4 * np.eye(4), a.T @ b)

        def press(k):
            rows = np.arange(k)
            left_out = [f[j] - base - z[j] @ solve(rows[rows != j]) for j in rows]
            return np.mean(np.square(left_out))

        best = min(range(5, 13), key=press)
        return 15 + base + solve(np.arange(best))[0]

    show("boada.force_n", [local(np.array(q)) for q in [(0.1, 0.2, -0.3), (-0.6, 0.4, 0.5), (0.8, -0.5, 0.9)]])


# P, equation 4.7 with the printed numbers of two experiments (thesis, tables B.8 and B.9), in pounds and inches.


def relation():
    rows = {
        "rp-aprbs": [11.548, 12.648, -2.426, 0.0161, 0.0030, -0.0011, -0.00015, -4.56e-5, -2.35e-6]
        + [5.76e-5, -2.42e-5, 3.11e-6, -1.48e-9, 7.17e-10, -7.68e-11],
        "rp3-cs": [6.604, 15.716, 0.148, 0.0256, -0.0035, 0.0010, -0.00031, -4.24e-5, 4.08e-5]
        + [2.81e-5, -1.08e-5, -3.26e-7, -2.07e-9, 1.62e-9, -3.18e-10],
    }
    points = [(3.0, 60.0, 400.0, -15000.0, 0.5), (-6.0, -150.0, 900.0, 22000.0, 1.75)]
    for name, numbers in rows.items():
        values = []
        for v, f, rate, curvature, i in points:
            p = np.reshape(numbers, (5, 3)) @ [1, i, i * i]
            values.append(p @ [v, rate, curvature, f**3, f**5])
        show(f"relation.{name}_lbf", values)


# Skyhook gains blended by Gaussian sets over the current.


def skyhook():
    gains, centres = np.array([2000.0, 1200.0, 600.0, 400.0]), np.array([0.0, 0.5, 1.5, 2.4])
    sigma = np.diff(centres).mean() / 2
    u = np.array([0.0, 0.3, 0.77, 1.5, 2.2, 2.5])
    g = np.array([skfuzzy.gaussmf(u, c, sigma) for c in centres])
    show("skyhook.damping_n_s_m", gains @ g / g.sum(axis=0))


if __name__ == "__main__":
    for part in [back_propagation, recursion, narx, kwok, du_zhang, laws, memberships, files, boada, relation, skyhook]:
        part()
