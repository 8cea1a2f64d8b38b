"""node/docs/BENCHMARKS.md out of what was measured."""

from common import ROOT

PATH = ROOT / "node" / "docs" / "BENCHMARKS.md"

HEAD = """# What it costs

Made by `tests/bench/bench.py`, which measures all of it anew in about half an hour; `tests/bench/bench.py NAME` one section. Times are
of the machine that each section names; ratios are of one run, its sides in turns, and travel further. Instructions are counted by
valgrind's callgrind, as the difference of two lengths, and depend on compiler and libraries alone.
"""


def table(head, rows):
    # Names to the left, figures to the right.
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    return "\n".join(lines + ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]) + "\n"


def verdict(figure, limit):
    return "met" if figure <= limit else f"missed by {100 * (figure / limit - 1):.0f} %"


def step(figures):
    ns, counted, single = figures["ns"], figures["instructions"], figures["single_ns"]
    idle = counted["nothing"]
    goals = [
        ("ARX", "thesis/arx-semi-active/rp-icps-l", ns["thesis"], 10),
        ("current-fuzzy tanh, 7 sets", "thesis/fuzzy-tanh/rp3-cs", ns["thesis"], 60),
        ("ANFIS, 27 rules", "thesis/anfis/rp1-cs", ns["thesis"], 200),
        ("tanh (S-P)", "thesis/sp-semi-active/rp3-cs", ns["thesis"], None),
        ("pipeline, fuzzy-tanh alone", "fuzzy-tanh", ns["pipeline"], 300),
        ("pipeline, ARX seeded beside it", "fuzzy-tanh + arx", ns["pipeline"], 300),
        ("the same with a coil lag", "fuzzy-tanh with coil lag + arx", ns["pipeline"], 300),
        ("or with a spring in series", "fuzzy-tanh with spring in series + arx", ns["pipeline"], 300),
        ("the same without either, commanding a current", "fuzzy-tanh + arx + command", ns["pipeline"], None),
    ]
    rows = []
    for what, name, of, goal in goals:
        said = f"{goal} ns: {verdict(of[name], goal)}" if goal else "-"
        median, worst = single[name][0], single[name][3]
        rows.append([what, f"{of[name]:.1f}", said, counted[name] - idle, f"{median} / {worst}"])
    without = ns["pipeline"]["fuzzy-tanh + arx"]
    lag, spring = (ns["pipeline"][f"fuzzy-tanh with {effect} + arx"] / without for effect in ("coil lag", "spring in series"))
    head = ["one sample", "ns", "goal", "instructions", "single: median / worst, ns"]
    others = sorted([*ns["identified"].items(), *ns.get("p", {}).items()], key=lambda row: row[1])
    each = ", ".join(f"{name} {took:.0f}" for name, took in others)
    return f"""## A step

Free run of a model, and the whole of what the estimating thread does with a sample: gates, conditioning, both models, supervisor,
residual, doubt, flags. Means over 15 360 samples of the peers' problem, and over 2 048 instants of displacement, current and force.

{table(head, rows)}
"Single" times each of a million steps by itself (with about {single["nothing"][0]} ns that the clock takes, and the motion, which is worked out
in it); each is the least of five passes, so the worst is a step that is long and not one that the system broke into. Nothing in a step
allocates (`model/tests/no_alloc.rs`), locks or calls the system. What the estimating thread itself asks of the system is to park and to
wake a sink that has parked.

What one effect adds to the whole of a sample, goal 1.2: coil lag {lag:.2f}, {verdict(lag, 1.2)}; a spring in series, which is solved for and costs the
most of them, {spring:.2f}, {verdict(spring, 1.2)} (`cargo bench -p mr-damper-model --bench effects` has all of them).

Every model that can be identified, following the current, ns: {each}.

The exponentials and tanh functions of the step are shared or our own (`model/src/force/tanh.rs`); the plain ones of the standard
library are the tests' oracle, to 1e-12.
"""


def round_trip(figures):
    bare = figures["bare ros2-client echo"]
    rclpy = figures["rclpy node with the model"]
    rows = []
    for name, trip in figures.items():
        rows.append([
            name, *(f"{trip[f]:.0f}" for f in ("p50_us", "p90_us", "p99_us")), f"{trip['lost']:.0f}",
            f"{trip['p50_us'] / bare['p50_us']:.2f}", f"{trip['p99_us'] / bare['p99_us']:.2f}",
        ])  # fmt: skip
    node = figures["this node"]
    of = {
        "median over the bare echo": (node["p50_us"] / bare["p50_us"], 1.15),
        "99 % over the bare echo": (node["p99_us"] / bare["p99_us"], 1.3),
        "median over the rclpy node": (node["p50_us"] / rclpy["p50_us"], 0.6),
    }
    goals = ". ".join(f"{what} {ratio:.2f}, goal {goal}: {verdict(ratio, goal)}" for what, (ratio, goal) in of.items())
    head = ["at the other end", "median, us", "90 %", "99 %", "lost", "median / echo", "99 % / echo"]
    return f"""## Round trip

An rclpy peer (Jazzy, Fast DDS) sends displacement, current and force at 1 kHz and waits for the estimate of each displacement. Its own cost is
in every row alike. Three turns of 10 s each, in turns; the middle one of each figure.

{table(head, rows)}
{goals}. The rclpy node has the same model and nothing else: no gates, no supervisor, no residual. Both echoes do nothing at all;
that of CycloneDDS says what a DDS in C would save.
"""


def stages(told):
    rows = []
    for name, what in [
        ("waiting", "in the ring before the step"),
        ("stepping", "step, with its events put into rings"),
        ("publishing", "message made and handed to DDS"),
        ("latency", "all of it: taken from DDS, to published"),
    ]:
        said = [told["said"].get(f"{name}_{q}_ms") for q in ("median", "p99", "worst")]
        rows.append([what, *("-" if ms is None else f"{1e3 * ms:.1f}" for ms in said)])
    return table(["within the node, us", "median", "99 %", "worst"], rows)


def scale(figures):
    rows = []
    for told in figures:
        said = told["said"]
        rows.append([
            f"{told['dampers']} x {told['rate_hz']:.0f} Hz", f"{told['dampers'] * told['rate_hz']:.0f}", told["lost"],
            f"{told['node_cores']:.2f}", f"{told['driver_cores']:.2f}", f"{told['memory_mb']:.0f}",
            f"{said.get('latency_median_ms', 0):.2f} / {said.get('latency_p99_ms', 0):.2f}", f"{told['driver_late_ms']:.0f}",
        ])  # fmt: skip

    def goal(dampers, rate_hz):
        told = next(told for told in figures if (told["dampers"], told["rate_hz"]) == (dampers, rate_hz))
        met = told["lost"] == 0 and told["node_cores"] < 1.0
        return f"{dampers} x {rate_hz} Hz: {told['lost']} lost at {told['node_cores']:.2f} of two cores, {'met' if met else 'missed'}"

    clean = [told["dampers"] * told["rate_hz"] for told in figures if told["lost"] == 0]
    head = ["dampers", "samples/s", "lost", "node, cores", "driver, cores", "node, MB", "sample to estimate, ms: median / 99 %", "driver late, ms"]
    one = next(told for told in figures if told["dampers"] == 1)
    return f"""## Many dampers

One process, a namespace, a pipeline and five rings a damper; displacement and current in, estimates out, all over DDS. Ten seconds each. The driver
is a ros2-client program on the same two cores: where both together want more than there is, it is late, and what it lost on the way
counts as lost here too. Medians and 99th percentiles are of a second, the worst damper's.

{table(head, rows)}
Half a machine is one core here. Goals, without loss and under half of the machine: {goal(16, 512)}; {goal(4, 1000)}. The most without loss: {max(clean):.0f} samples a second.

Where the time goes, one damper at 1 kHz:

{stages(one)}
What is left between the stages and the whole is the sink's thread being woken. Outside of the node are DDS's own threads, the kernel and the
peer.
"""


def realtime(figures):
    rows = []
    for told in figures:
        said = told["said"]
        us = [f"{1e3 * said.get(key, 0):.0f}" for key in ("stepping_worst_ms", "waiting_worst_ms", "latency_p99_ms", "latency_worst_ms")]
        load = f"{told['busy']} threads that only compute" if told["busy"] else "idle but for the driver"
        priority = f"SCHED_FIFO {told['priority']}" if told["priority"] else "none"
        rows.append([load, priority, *us, f"{said.get('missed_deadlines', 0):.0f}", told["lost"]])
    head = ["machine", "`realtime_priority`", "worst step, us", "worst wait for it, us", "99 % latency, us", "worst latency, us",
            "missed 2 ms (all told)", "lost"]  # fmt: skip
    return f"""## In time

One damper at 1 kHz for 30 s on two cores, `deadline_s` 2 ms. A step is the pipeline's work with its events put into rings, as the thread sees it: with
whatever broke into it. The driver has no priority, and is late on a busy machine whatever the node does. Missed deadlines are counted from the
start of the process, with some 50 while endpoints are matched; the other figures leave that out.

{table(head, rows)}
"""


def offline(figures):
    def row(name, one, samples, count):
        return [name, f"{one['seconds']:.2f}", f"{samples / one['seconds'] / 1e6:.2f}", f"{count / one['seconds'] / 1e6:.2f}",
                f"{one['memory_mb']:.0f}"]  # fmt: skip

    samples, big = figures["samples"], figures["big"]
    rows = [
        row(f"bag (MCAP, zstd), {figures['bag_mb']:.0f} MB", figures["bag"], samples, figures["messages"]),
        row(f"CSV, {figures['csv_mb']:.0f} MB", figures["csv"], samples, figures["messages"]),
        row(f"bag, {big['mb']:.0f} MB", big, big["samples"], big["messages"]),
    ]
    readings = figures["messages"] / figures["bag"]["seconds"]
    played = figures["replay"]
    per = (big["memory_mb"] - figures["bag"]["memory_mb"]) / (big["messages"] - figures["messages"]) * 1e6
    head = ["`evaluate`, end to end", "s", "million instants/s", "million readings/s", "largest memory, MB"]
    return f"""## Offline

`evaluate` of fuzzy-tanh: file read and hashed (SHA-256), unpacked, decoded, run through the pipeline, scored. An instant has a displacement and so an estimate; a reading is
one value of one channel ({figures["messages"] / samples:.0f} of them an instant here: set point and temperatures are read, too).

{table(head, rows)}
Goal: 2 million samples a second: {readings / 1e6:.1f} million readings, but {samples / figures["bag"]["seconds"] / 1e6:.1f} million instants, so met by the one and missed by the other. Goal: a bag of 2 GB
in bounded memory: missed. A run is kept whole, {per:.0f} bytes a reading (16 are its stamp and value), since its figures need its mean before its
errors; a bag that is all one damper's takes about its own size.

Played through the node over DDS at `--rate max`, a minute of 512 Hz takes {played["seconds"]:.1f} s with start and discovery:
{played["samples"] / played["seconds"]:.0f} instants a second. That is what the player allows itself, 4000 messages a second, since DDS drops some of a longer
burst without a word; the pipeline alone is `evaluate`, above.
"""


def identification(figures):
    def name(row):
        options = " ".join(row["options"])
        return f"{row['model']}{' ' + options if options else ''}, {row['runs']} run{'s' if row['runs'] > 1 else ''}"

    rows = [[name(row), f"{row['seconds']:.2f}", f"{row['processor_s']:.2f}", f"{row['memory_mb']:.0f}"] for row in figures["growth"]]
    return f"""## Identification

On one problem, beside what Python has (`tests/peers/run.sh`, which fails where a goal is missed):

```text
{figures["table"].strip()}
```

The command as a whole, on runs of 30 s at 512 Hz of the virtual rig:

{table(["`identify`", "s", "processor, s", "MB"], rows)}"""


def closing(figures):
    def what(row):
        few = row["effects"]
        return f"{len(few)}: {', '.join(few)}" if few else "the whole library"

    rows = [
        [f"3 x {row['run_s']} s", what(row), f"{row['seconds']:.1f}", f"{row['processor_s']:.1f}", f"{row['memory_mb']:.0f}"]
        for row in figures
    ]
    thirty = next(row for row in figures if row["run_s"] == 30 and not row["effects"])
    return f"""## Closing the loop

`close` on three runs at 512 Hz of the virtual rig (estimate, confirm, sealed), whose coil lags: effects scored, the best of them refitted with the base,
confirmed. Goal for three runs of 30 s: 10 s, {verdict(thirty["seconds"], 10)}. A candidate costs a free run or some, and a refit
where its score promises anything; the whole library costs most when a second effect passes. None of the peers names an effect, so there is nobody to compare with.

{table(["runs", "effects looked for (`--effects`)", "s", "processor, s", "MB"], rows)}"""


def fuzz(figures):
    rows = [[one["target"], one["runs"], one["per_s"], one["features"], one["found"]] for one in figures]
    return f"""## Fuzzing

Every reader of what comes from outside, a minute each, from committed corpora (`tests/fuzz/README.md`; `tests/fuzz/run.sh --hour` takes an hour each).

{table(["target", "inputs", "a second", "features", "found"], rows)}"""


def coverage(figures):
    share = 1 - figures["missed"] / figures["lines"]
    least = ", ".join(f"`{name}` {100 * of:.0f}" for of, name in figures["least"])
    return f"""## Lines that tests run

`model/`, by its own tests (`.ci/coverage`): {100 * share:.1f} % of {figures["lines"]} lines, those of tests within them. The least, %: {least}.
"""


def soak(figures):
    third, last = figures["third"], figures["last"]
    grown = 100 * (last[0] / third[0] - 1)
    share = 100 * figures["lost"] / figures["displacements"]
    ahead = f"; node and driver ran ahead of all else, at nice {figures['nice']}" if figures["nice"] < 0 else ""
    return f"""## An hour

{figures["dampers"]} dampers at {figures["rate_hz"]} Hz: {figures["displacements"]} displacements, {figures["lost"]} ({share:.3f} %) without an estimate; the driver was late by {figures["late_s"]:.2f} s at most,
with a load average of {figures["load"]:.1f} on the machine (1 or less when it is idle but for this){ahead}.
The node after twenty minutes, and at the end: {third[0] / 1024:.1f} and {last[0] / 1024:.1f} MiB ({grown:+.1f} %), {third[1]} and {last[1]} threads, {third[2]} and {last[2]} open files.
"""


def mutants(figures):
    goal = "met" if figures["percent"] >= 85 else "missed"
    # Put into the section's file by hand, by whoever wrote a test, put the change back and saw it fail.
    since = figures.get("noticed_since", [])
    missed = "".join(f"- `{change}`{' *' if change in since else ''}\n" for change in figures["missed"])
    return f"""## Wrong changes that tests notice

`model/`, changed in one place at a time by cargo-mutants (`.ci/mutants`), every n-th of some twelve thousand changes: {figures["caught"]} of {figures["of"]} noticed, {figures["percent"]} % (95 %: {figures["low"]} to {figures["high"]});
{figures["unviable"]} more did not compile. Goal 85 %: {goal}.

Not noticed (line of the commit below{"; what is marked * is noticed by tests that were written since" if since else ""}):

{missed}"""


def write(results, order):
    """Writes the document of all sections that were measured."""
    parts = [HEAD]
    for name in order:
        if name not in results:
            parts.append(f"## {name}\n\nNot measured yet: `tests/bench/bench.py {name}`.\n")
            continue
        result = results[name]
        body = globals()[name](result["figures"]).rstrip()
        parts.append(f"{body}\n\n*{result['when']}, commit {result['commit']}, {result['took_s']} s; {result['machine']}.*\n")
    PATH.write_text("\n".join(parts))
