#!/usr/bin/env python3
"""Measures the effect of a failing reader on the others; prints the tables of node/docs/reader-faults.md. Root only.

For each rate it starts a node and an ECU (ecu_peer) in their own network namespace, with sensors, estimates and commands of one or
four dampers. Then one reader after another joins, fails, and is observed for --seconds; the ECU reports its losses during that time
and the delays of the other messages. Readers on another host get one, at a switch whose port is then unplugged.

    healthy   no fault: the cost of any further reader
    kill      SIGKILL: the reader is gone, but its lease continues
    stop      SIGSTOP, and SIGCONT after the lease has expired
    slow      the reader sleeps for 20 ms on each message
    busy      the reader computes for 20 ms on each message, which keeps a core busy; it is compared with a slow reader beside a program
              that keeps a core busy, so that the ratio does not show what any such program takes from a shared processor
    mute      the reader never acknowledges, but keeps renewing its lease
    unplug    the reader is on another host, whose cable is unplugged

usage: fault_table.py [--node BINARY] [--ecu BINARY] [--build NAME] [--rates 500,1000,4x1000] [--cases rclpy-kill,...] [--seconds 25]
                      [--quiet 8] [--realtime PRIORITY] [--node-realtime PRIORITY] [--ecu-realtime PRIORITY]

The delays contain the time that the threads of the ECU wait for a processor, which the reader may use. --ecu-realtime keeps it small, so
that the delays show the node. The last table has the time that the threads of both wait for a processor, from /proc/PID/task/*/schedstat.

Progress goes to stderr; Markdown tables and then one line of JSON go to stdout. Exit code 1 if an answer was lost.
"""

import argparse
import contextlib
import json
import os
import pathlib
import random
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent.parent / "target"))
BASE = pathlib.Path(os.environ.get("MR_DAMPER_INTEROP_DIR", "/var/tmp/mr-damper-interop"))
CASES = [
    "rclpy-healthy", "rclpy-kill", "rclpy-stop", "rclpy-slow", "rclpy-busy", "cyclone-kill", "cyclone-stop", "ros2client-kill",
    "ros2client-stop", "mute", "rclpy-unplug",
]  # fmt: skip
# Name of the phases in which all readers are healthy.
QUIET = "without a victim"
# Name of the phases with a slow reader and a program that is busy.
BUSY = "a slow reader and a busy program"
BUSY_PROGRAM = "while True: pass"
MODEL = "thesis/fuzzy-tanh/rp3-cs"


def say(text):
    print(f"fault_table: {text}", file=sys.stderr, flush=True)


class Program:
    """A program in a namespace, with lines of JSON on its standard output."""

    def __init__(self, host, command, log, **environment):
        self.log = log
        enter = [HERE / "netns.sh", "enter", str(host.pid), *map(str, command)]
        self.process = subprocess.Popen(
            enter, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=open(log, "w"), text=True, env={**os.environ, **environment}
        )

    def line(self):
        text = self.process.stdout.readline()
        if not text:
            sys.exit(f"fault_table: {self.process.args[3:]} ended without an answer; its log:\n{open(self.log).read()[-2000:]}")
        return json.loads(text)

    def tell(self, text):
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()

    def end(self):
        """Closes its standard input and waits; kills it if it does not end."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
        self.process.stdin.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class Host:
    """A network namespace with only loopback."""

    def __init__(self):
        self.holder = subprocess.Popen([HERE / "netns.sh", "hold"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.pid = int(self.holder.stdout.readline())

    def run(self, script):
        subprocess.run([HERE / "netns.sh", "enter", str(self.pid), "bash", "-euc", script], check=True)

    def end(self):
        self.holder.stdin.close()
        self.holder.wait()


def switch(near, middle, far):
    """Connects `near` (10.78.0.1) and `far` (10.78.0.2) to a switch in `middle`."""
    middle.run("ip link add sw type bridge && ip link set sw up")
    for number, host in ((1, near), (2, far)):
        subprocess.run(
            ["ip", "link", "add", "eth", "netns", str(host.pid), "type", "veth", "peer", "name", f"port{number}", "netns", str(middle.pid)], check=True
        )
        middle.run(f"ip link set port{number} master sw up")
        host.run(f"ip addr add 10.78.0.{number}/24 dev eth && ip link set eth up && ip route replace 224.0.0.0/4 dev eth")


def fault_of(case):
    return case.rsplit("-", 1)[-1]


def victim(case, dampers, args):
    """Command of the failing reader."""
    fault = fault_of(case)
    match case.split("-")[0]:
        case "rclpy":
            slow = {"slow": ["--wait", "0.02"], "busy": ["--work", "0.02"]}.get(fault, [])
            return [HERE / "ros-python.sh", "jazzy", HERE / "victim_peer.py", "--dampers", dampers, *slow]
        case "cyclone":
            return [BASE / "peers/venv/bin/python", HERE / "cyclone_victim.py", dampers]
        case "ros2client":
            return [args.ecu, "--hear", "--dampers", dampers, "--loopback"]
    ours = "mr_damper_msgs::msg::dds_::"
    topics = [
        f"rt/d{k}/{topic}={ours}{of}_" for k in range(dampers) for topic, of in (("force_estimate", "ForceEstimate"), ("current_command", "CurrentCommand"))
    ]
    return [sys.executable, HERE / "mute_reader.py", *topics]


def waited_ms(pid):
    """Time that the threads of a process have waited for a processor since they started, ms."""
    waited_ns = 0
    for thread in pathlib.Path(f"/proc/{pid}/task").glob("*/schedstat"):
        # A thread may end while this reads.
        with contextlib.suppress(OSError):
            waited_ns += int(thread.read_text().split()[1])
    return waited_ns / 1e6


class Session:
    """A node and an ECU at one rate."""

    def __init__(self, args, rate_hz, dampers, folder, subnet):
        self.args, self.dampers, self.folder, self.subnet = args, dampers, folder, subnet
        # Fast DDS shares memory by domain id, even across network namespaces.
        self.environment = {"ROS_DOMAIN_ID": str(1 + (os.getpid() * 7 + time.monotonic_ns() // 10**9) % 100)}
        self.hosts = [Host() for _ in range(3 if subnet else 1)]
        if subnet:
            switch(*self.hosts)
            self.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
        names = ",".join(f"d{k}" for k in range(dampers))
        parameters = [f"model:={MODEL}", f"dampers:=[{names}]", "law:=fixed"]
        if args.node_realtime is not None:
            parameters.append(f"realtime_priority:={args.node_realtime}")
        ros_args = [word for parameter in parameters for word in ("-p", parameter)]
        self.node = self.program(self.hosts[0], [args.node, "node", "--ros-args", *ros_args], "node")
        reach = [] if subnet else ["--loopback"]
        scheduler = ["chrt", "--fifo", args.ecu_realtime] if args.ecu_realtime else []
        self.ecu = self.program(self.hosts[0], [*scheduler, args.ecu, "--rate", rate_hz, "--dampers", dampers, *reach], "ecu")
        self.ecu.line()
        # For each phase, how long the threads of node and ECU waited for a processor, ms in a second.
        self.waits = []

    def program(self, host, command, name):
        return Program(host, command, self.folder / f"{name}.log", **self.environment)

    def phase(self, name, seconds):
        self.ecu.tell(name)
        self.ecu.line()
        programs = {"node": self.node.process.pid, "ecu": self.ecu.process.pid}
        before = {who: waited_ms(pid) for who, pid in programs.items()}
        time.sleep(seconds)
        self.waits.append({who: (waited_ms(pid) - before[who]) / seconds if seconds else None for who, pid in programs.items()})

    def join(self, case):
        """A reader that joins, and is healthy so far."""
        self.phase(f"{case} joins", 0.0)
        host = self.hosts[2 if self.subnet else 0]
        reader = self.program(host, victim(case, self.dampers, self.args), case)
        reader.line()
        return reader

    def leave(self, case, reader):
        self.phase(f"{case} leaves", 0.0)
        reader.end()

    def busy(self):
        """A phase with a slow reader beside a busy program."""
        reader = self.join("rclpy-slow")
        program = self.program(self.hosts[0], [sys.executable, "-c", BUSY_PROGRAM], "busy")
        self.phase(BUSY, self.args.quiet)
        program.process.kill()
        program.process.wait()
        self.leave("rclpy-slow", reader)

    def case(self, case):
        say(f"  {case}")
        fault = fault_of(case)
        if fault == "busy":
            self.busy()
        reader = self.join(case)
        self.phase(f"{case} alive", 3.0)
        if fault == "unplug":
            self.hosts[1].run("ip link set port2 down")
        elif fault in ("kill", "stop"):
            reader.process.send_signal(signal.SIGKILL if fault == "kill" else signal.SIGSTOP)
        self.phase(case, self.args.seconds)
        self.leave(case, reader)
        if fault == "unplug":
            self.hosts[1].run("ip link set port2 up")
        if fault == "busy":
            self.busy()
        self.phase(QUIET, self.args.quiet)

    def end(self):
        self.ecu.process.stdin.close()
        report = json.loads(self.ecu.process.stdout.readline())
        self.ecu.process.wait(20)
        self.node.process.send_signal(signal.SIGINT)
        self.node.process.wait(20)
        ended = [line for line in open(self.node.log) if "the node has ended" in line]
        # The ECU's first phase ends with the first one that has a name.
        for phase, waited in zip(report["phases"][1:], self.waits, strict=True):
            phase["waits_ms_per_s"] = waited
        report["node_lost"] = sum(int(n) for line in ended for n in re.findall(r"\blost\S*?=\S*?(\d+)", line)[:1])
        for host in reversed(self.hosts):
            host.end()
        return report


KINDS = ("estimates", "commands")
WHO = ("node", "ecu")


def waits(phase, who):
    """How long the threads of node or ECU waited for a processor, ms in a second."""
    return phase["waits_ms_per_s"][who]


def seconds(phases, kind):
    """The 99th percentile of each whole second of these phases, ms."""
    return [value for phase in phases for value in phase[kind]["p99_of_seconds_ms"] if value is not None]


def ratio(faulty, quiet):
    """Ratio of the medians of two lists of seconds, and its 95 % interval (bootstrap over the seconds, fixed seed); None without answers."""
    if not faulty or not quiet:
        return None
    draw = random.Random(1).choices
    drawn = sorted(statistics.median(draw(faulty, k=len(faulty))) / statistics.median(draw(quiet, k=len(quiet))) for _ in range(2000))
    return [statistics.median(faulty) / statistics.median(quiet), drawn[50], drawn[1949]]


def rows(build, rate, report):
    """Figures of each case at one rate: the case compared with the phases of its reference before and after it."""
    phases = report["phases"]
    for index, phase in enumerate(phases):
        case = phase["name"]
        if case not in CASES:
            continue
        reference = BUSY if fault_of(case) == "busy" else QUIET
        reference_at = [at for at, other in enumerate(phases) if other["name"] == reference]
        before = max(at for at in reference_at if at < index)
        after = min(at for at in reference_at if at > index)
        # A reader that joins or leaves must not cause losses either: these phases count as part of the case.
        around = phases[before + 1 : after]
        yield {
            "build": build,
            "rate": rate,
            "case": case,
            "sent": sum(part["sent"] for part in around),
            **{f"{kind}_lost": sum(part[kind]["lost"] for part in around) for kind in KINDS},
            **{f"{kind}_p99_ms": phase[kind]["p99_ms"] for kind in KINDS},
            **{
                f"{kind}_p99_ratio": ratio(seconds([phase], kind), seconds([phases[before], phases[after]], kind))
                for kind in KINDS
            },
            "waits_ms_per_s": {who: (waits(phase, who), statistics.mean(waits(phases[at], who) for at in (before, after))) for who in WHO},
            "worst_ms": max(phase[kind]["worst_ms"] or 0.0 for kind in KINDS),
        }


def losses(row):
    """Estimates lost, of the displacements sent; and commands lost, if there are any."""
    commands = f", {row['commands_lost']} commands" if row["commands_lost"] else ""
    return f"{row['estimates_lost']} of {row['sent']}{commands}"


def delays(row, kind):
    value = row[f"{kind}_p99_ratio"]
    return "{:.2f} ({:.2f} to {:.2f})".format(*value) if value else "-"


def processor(row):
    """How long node and ECU waited for a processor, ms in a second; in brackets without the reader."""
    return ", ".join("{:.0f} ({:.0f})".format(*row["waits_ms_per_s"][who]) for who in WHO)


def table(found, title, cell, last=None):
    """Prints a Markdown table with a line for each case and a column for each rate; `last` is a heading and a function of a case's rows."""
    rates = list(dict.fromkeys(row["rate"] for row in found))
    headings = [title, *(f"{rate} Hz" for rate in rates), *([last[0]] if last else [])]
    print(f"\n| {' | '.join(headings)} |\n|{'---|' * len(headings)}")
    for case in dict.fromkeys(row["case"] for row in found):
        by_rate = {row["rate"]: row for row in found if row["case"] == case}
        cells = [cell(by_rate[rate]) for rate in rates] + ([last[1](by_rate.values())] if last else [])
        print(f"| {case} | {' | '.join(cells)} |")


def tables(found):
    """The tables of one build in node/docs/reader-faults.md."""
    table(found, "estimates lost", losses, ("worst delay, ms", lambda of_case: f"{max(row['worst_ms'] for row in of_case):.1f}"))
    for kind in KINDS:
        table(found, f"p99 of {kind}, ratio (95 %)", lambda row, kind=kind: delays(row, kind))
    table(found, "node and ECU wait for a processor, ms in a second (without the reader)", processor)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--node", default=TARGET / "release/mr-damper", metavar="BINARY")
    parser.add_argument("--ecu", default=TARGET / "release/ecu_peer", metavar="BINARY")
    parser.add_argument("--build", default="default", metavar="NAME", help="name of the node's build in the table")
    parser.add_argument("--rates", default="500,1000,4x1000", help="Hz, or dampers x Hz")
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--seconds", type=float, default=25.0, help="time to observe a fault; the lease of rclpy is 20 s")
    parser.add_argument("--quiet", type=float, default=8.0, help="seconds without a victim after each case")
    parser.add_argument("--realtime", type=int, metavar="PRIORITY", help="SCHED_FIFO priority of node and ECU; the failing reader has none")
    parser.add_argument("--node-realtime", type=int, metavar="PRIORITY", help="realtime_priority of the node alone; the default is the node's")
    parser.add_argument("--ecu-realtime", type=int, metavar="PRIORITY", help="SCHED_FIFO priority of the ECU alone")
    args = parser.parse_args()
    if args.realtime is not None:
        args.node_realtime = args.ecu_realtime = args.realtime
    if os.geteuid() != 0:
        sys.exit("fault_table: network namespaces, raw sockets and cables take root")
    unknown = set(args.cases.split(",")) - set(CASES)
    if unknown:
        sys.exit(f"fault_table: unknown cases {', '.join(sorted(unknown))}; cases are {', '.join(CASES)}")
    found, reports = [], []
    for rate in args.rates.split(","):
        dampers, hz = (int(part) for part in (rate if "x" in rate else f"1x{rate}").split("x"))
        for subnet in (False, True):
            cases = [case for case in args.cases.split(",") if case.endswith("unplug") == subnet]
            if not cases:
                continue
            say(f"{args.build}, {rate} Hz{', two hosts' if subnet else ''}")
            with tempfile.TemporaryDirectory() as folder:
                session = Session(args, hz, dampers, pathlib.Path(folder), subnet)
                # The first displacements wait for each other, and the filters settle.
                session.phase("warm-up", 3.0)
                session.phase(QUIET, args.quiet)
                for case in cases:
                    session.case(case)
                report = session.end()
            found += rows(args.build, rate, report)
            reports.append({"rate": rate, **report})
    tables(found)
    print(json.dumps({"rows": found, "sessions": reports}))
    elsewhere = sum(phase[kind]["lost"] for report in reports for phase in report["phases"] for kind in ("estimates", "commands"))
    sys.exit(elsewhere > 0)


if __name__ == "__main__":
    main()
