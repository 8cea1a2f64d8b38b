"""Writes node/docs/BENCHMARKS.md from the results."""

from common import ROOT

PATH = ROOT / "node" / "docs" / "BENCHMARKS.md"

HEAD = """# Benchmarks

`tests/bench/bench.py` writes this page; it measures all sections in about half an hour, and `tests/bench/bench.py NAME` measures one
section. Times belong to the machine that the section names. Ratios compare programs that ran in turns on one machine, so they apply
to other machines as well. Instructions are counted by valgrind's callgrind as the difference of two run lengths; they depend only on
compiler and libraries.
"""


def table(head, rows):
    # Names are left-aligned, numbers right-aligned.
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
        ("pipeline, with seeded ARX", "fuzzy-tanh + arx", ns["pipeline"], 300),
        ("the same, with a coil lag effect", "fuzzy-tanh with coil lag + arx", ns["pipeline"], 300),
        ("the same, with a series spring effect", "fuzzy-tanh with spring in series + arx", ns["pipeline"], 300),
        ("the same, without effects, with inverse controller", "fuzzy-tanh + arx + command", ns["pipeline"], None),
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
    methods = ["search", "polynomial", "fuzzy", "chen", "wang-liao", "wang-hu"]
    commands = [f"{name} {counted[name] - idle}" for name in methods if name in counted]
    return f"""## One step

Time of one sample in simulation of a model, and in the whole pipeline of the estimating thread: gates, conditioning, both models,
supervisor, residual, uncertainty, flags. The times are means over 15 360 samples of the peers' problem (models), and over 2 048
instants of displacement, current and force (pipeline).

{table(head, rows)}
"Single" times each of a million steps by itself. It includes about {single["nothing"][0]} ns for reading the clock, and computing the motion. Each
value is the smallest of five passes, so the worst case is a long step, not one that was preempted. A step does not allocate
(`model/tests/no_alloc.rs`), lock or make system calls. The only system calls of the estimating thread are parking, and waking a sink
that has parked.

Time of a whole sample with one effect relative to none, goal 1.2: coil lag {lag:.2f}, {verdict(lag, 1.2)}; series spring, which is solved
for and is the most expensive effect, {spring:.2f}, {verdict(spring, 1.2)} (`cargo bench -p mr-damper-model --bench effects` has all effects).

Time of each model that can be identified, following the current, in ns: {each}.

Instructions of one command of the inverse controller with the fuzzy-tanh model, by `inverse.method`: {", ".join(commands)}.
The last three are learned inverses with hand-set numbers; the step of the force model, which gives the achievable range, is included.

The exponentials and tanh functions of the step are shared or our own (`model/src/force/tanh.rs`); tests compare them with the
standard library's, to 1e-12.
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
    node = figures["this node, no priority"]
    of = {
        "median over the bare echo": (node["p50_us"] / bare["p50_us"], 1.15),
        "99 % over the bare echo": (node["p99_us"] / bare["p99_us"], 1.3),
        "median over the rclpy node": (node["p50_us"] / rclpy["p50_us"], 0.6),
    }
    goals = ". ".join(f"{what} {ratio:.2f}, goal {goal}: {verdict(ratio, goal)}" for what, (ratio, goal) in of.items())
    head = ["program under test", "median, us", "90 %", "99 %", "lost", "median / echo", "99 % / echo"]
    return f"""## Round trip

An rclpy peer (Jazzy, Fast DDS) sends displacement, current and force at 1 kHz and waits for the estimate of each displacement. Its own
cost is included in every row. Each program runs three times for 10 s, in turns; the table shows the median of the three runs.

{table(head, rows)}
{goals}. These ratios are of the node without priority, as the
others have none. The rclpy node has the same model and nothing else: no gates, no supervisor, no residual. Both echoes only return a message;
the echo with CycloneDDS shows what a DDS library in C would save.
"""


def stages(told):
    rows = []
    for name, what in [
        ("waiting", "waiting in the ring before the step"),
        ("stepping", "step, including writing its events to the rings"),
        ("publishing", "building the message and passing it to DDS"),
        ("latency", "total: from taking the sample from DDS to publishing"),
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

One process with a namespace, a pipeline and five rings per damper; displacement and current in, estimates out, all over DDS. Each row
is a run of ten seconds. The driver is a ros2-client program on the same two cores: if both together need more than the machine has,
the driver is late, and samples lost on the way count as lost here too. Medians and 99th percentiles cover one second, for the worst
damper.

{table(head, rows)}
Half of this machine is one core. Goals, without loss and with less than half of the machine: {goal(16, 512)}; {goal(4, 1000)}. Highest rate without loss: {max(clean):.0f} samples per second.

Time of the stages, one damper at 1 kHz:

{stages(one)}
The difference between the stages and the total is the time to wake the sink's thread. The threads of DDS, the kernel and the peer
are outside the node and not included.
"""


def realtime(figures):
    rows = []
    for told in figures:
        said = told["said"]
        us = [f"{1e3 * said.get(key, 0):.0f}" for key in ("stepping_worst_ms", "waiting_worst_ms", "latency_p99_ms", "latency_worst_ms")]
        load = f"{told['busy']} threads that only compute" if told["busy"] else "idle except for the driver"
        priority = f"SCHED_FIFO {told['priority']}" if told["priority"] else "none"
        rows.append([load, priority, *us, f"{said.get('missed_deadlines', 0):.0f}", told["lost"]])
    head = ["machine", "`realtime_priority`", "worst step, us", "worst wait for it, us", "99 % latency, us", "worst latency, us",
            "missed 2 ms (total)", "lost"]  # fmt: skip
    return f"""## Real time

One damper at 1 kHz for 30 s on two cores, `deadline_s` 2 ms. A step is the work of the pipeline including writing its events to the
rings, as the thread sees it: with all interruptions. The driver has no priority, and is late on a busy machine whatever the node does.
Missed deadlines are counted from the start of the process, with about 50 while endpoints are being matched; the other values leave
that time out.

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
    head = ["`evaluate`, end to end", "s", "million instants/s", "million readings/s", "largest memory, MB"]
    return f"""## Offline

`evaluate` of fuzzy-tanh: the file is read and hashed (SHA-256), decompressed, decoded, run through the pipeline and scored. An instant has
a displacement and so an estimate; a reading is one value of one channel ({figures["messages"] / samples:.0f} readings per instant here: set point and
temperatures are read, too).

{table(head, rows)}
Goal: 2 million samples per second. The result is {readings / 1e6:.1f} million readings, but {samples / figures["bag"]["seconds"] / 1e6:.1f} million instants, so the goal is met
counting readings and missed counting instants. Goal: a bag of 2 GB in 300 MB of memory: missed. Commands read a run as a whole; a reading
takes 16 bytes, for stamp and value. The largest memory is {100 * big["memory_mb"] / big["mb"]:.0f} % of the size of a bag with only one damper.

Replayed through the node over DDS at `--rate max`, one minute at 512 Hz takes {played["seconds"]:.1f} s including start and discovery:
{played["samples"] / played["seconds"]:.0f} instants per second. The player limits itself to 4000 messages per second, because DDS silently drops part of
longer bursts; the speed of the pipeline alone is `evaluate`, above.
"""


def identification(figures):
    def name(row):
        options = " ".join(row["options"])
        return f"{row['model']}{' ' + options if options else ''}, {row['runs']} run{'s' if row['runs'] > 1 else ''}"

    rows = [[name(row), f"{row['seconds']:.2f}", f"{row['processor_s']:.2f}", f"{row['memory_mb']:.0f}"] for row in figures["growth"]]
    return f"""## Identification

The same problem solved by this project and by tools available in Python (`tests/peers/run.sh`, which fails if a goal is missed):

```text
{figures["table"].strip()}
```

The whole command, on runs of the virtual rig of 30 s at 512 Hz:

{table(["`identify`", "s", "processor, s", "MB"], rows)}"""


def closing(figures):
    def what(row):
        few = row["effects"]
        return f"{len(few)}: {', '.join(few)}" if few else "the whole library"

    rows = [
        [
            f"3 x {row['run_s']} s",
            "given (`--fixed-base`)" if row["fixed"] else "chosen",
            what(row),
            f"{row['seconds']:.1f}",
            f"{row['processor_s']:.1f}",
            f"{row['memory_mb']:.0f}",
        ]
        for row in figures
    ]
    thirty, long = (next(row for row in figures if row["run_s"] == run_s and not row["fixed"]) for run_s in (30, 600))
    return f"""## Diagnosis

`close` on three runs of the virtual rig at 512 Hz (training, validation and test run) whose coil lags: effects are scored, the best of
them are refitted with the base and confirmed, and what they leave is searched for terms. Goal for three runs of 30 s: 4 s, {verdict(thirty["seconds"], 4)}. Goal for three runs of 600 s: 30 s,
{verdict(long["seconds"], 30)}; they are searched on stretches. By default other structures
are identified and diagnosed beside the base. A candidate effect costs several simulations, and a refit if its score is promising; the whole
library costs most when a second effect passes. None of the peers names an effect, so there is nothing to compare with.

{table(["runs", "structure", "candidate effects (`--effects`)", "s", "processor, s", "MB"], rows)}"""


def fuzz(figures):
    rows = [[one["target"], one["runs"], one["per_s"], one["features"], one["found"]] for one in figures]
    return f"""## Fuzzing

Every reader of outside data, for one minute each, from committed corpora (`tests/fuzz/README.md`; `tests/fuzz/run.sh --hour` takes an hour each).

{table(["target", "inputs", "per second", "features", "found"], rows)}"""


def coverage(figures):
    share = 1 - figures["missed"] / figures["lines"]
    least = ", ".join(f"`{name}` {100 * of:.0f}" for of, name in figures["least"])
    return f"""## Test coverage

`model/`, by its own tests (`.ci/coverage`): {100 * share:.1f} % of {figures["lines"]} lines, including lines of tests. Lowest, %: {least}.
"""


def soak(figures):
    third, last = figures["third"], figures["last"]
    grown = 100 * (last[0] / third[0] - 1)
    share = 100 * figures["lost"] / figures["displacements"]
    ahead = f"; node and driver had precedence over other processes, at nice {figures['nice']}" if figures["nice"] < 0 else ""
    return f"""## One hour

{figures["dampers"]} dampers at {figures["rate_hz"]} Hz: {figures["displacements"]} displacements, {figures["lost"]} ({share:.3f} %) without an estimate; the driver was late by {figures["late_s"]:.2f} s at most,
with a load average of {figures["load"]:.1f} on the machine (1 or less if it is otherwise idle){ahead}.
The node after twenty minutes and at the end: {third[0] / 1024:.1f} and {last[0] / 1024:.1f} MiB ({grown:+.1f} %), {third[1]} and {last[1]} threads, {third[2]} and {last[2]} open files.
"""


def mutants(figures):
    goal = "met" if figures["percent"] >= 85 else "missed"
    # Added to the section's file by hand, after a new test was seen to fail with the change.
    since = figures.get("noticed_since", [])
    missed = "".join(f"- `{change}`{' *' if change in since else ''}\n" for change in figures["missed"])
    return f"""## Mutation testing

`model/`, changed in one place at a time by cargo-mutants (`.ci/mutants`), every n-th of about twelve thousand changes: {figures["caught"]} of {figures["of"]} noticed, {figures["percent"]} % (95 %: {figures["low"]} to {figures["high"]});
{figures["unviable"]} more did not compile. Goal 85 %: {goal}.

Not noticed (line of the commit below{"; changes marked * are noticed by tests written since" if since else ""}):

{missed}"""


def write(results, order):
    """Writes the document with all sections that have results. The others keep their text, which may come from another machine."""
    before = PATH.read_text().split("\n## ")[1:] if PATH.exists() else []
    # One section for each name, in this order; otherwise the order has changed, and the old text belongs to no known section.
    kept = dict(zip(order, before)) if len(before) == len(order) else {}
    parts = [HEAD]
    for name in order:
        if name in results:
            result = results[name]
            body = globals()[name](result["figures"]).rstrip()
            parts.append(f"{body}\n\n*{result['when']}, commit {result['commit']}, {result['took_s']} s; {result['machine']}.*\n")
        elif name in kept:
            parts.append(f"## {kept[name].rstrip()}\n")
        else:
            parts.append(f"## {name}\n\nNot measured yet: `tests/bench/bench.py {name}`.\n")
    PATH.write_text("\n".join(parts))
