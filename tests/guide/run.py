#!/usr/bin/env python3
"""Run every command of README.md and node/docs/guide, and check the links of all Markdown files of the documentation.

usage: tests/guide/run.py [--list] [PAGE...]      PAGE: a path below the repository; default: README.md and the guide in order

Each block fenced by ```sh runs with `bash -eu` in a scratch directory of its page, with `mr-damper` on PATH: $MR_DAMPER_BIN, or
target/release/mr-damper. Root runs two pages at a time, each in its own network namespace that has loopback only
(tests/interop/netns.sh); other users run one page after the other. Nothing outside the scratch directories is written. An HTML comment in
front of a block changes how it runs; a reader of the page does not see it:

    <!-- run: skip, REASON -->           the block does not run; the reason is printed
    <!-- run: background 5 s -->         the block runs in the background. It passes if it still runs after 5 s, and if it ends in an
                                         orderly way on SIGINT at the end of the page
    <!-- run: limit 300 s -->            time limit; 60 s without this
    <!-- run: file NAME -->              the block (of any language) is written to NAME in the scratch directory
    <!-- run: setup [limit N s | background N s]
    COMMANDS                             hidden commands, which run at this place
    -->

Prints one line for each block and ends with `N passed, N failed, N skipped`; the exit code is 1 if a block failed, and 2 if a page has a comment
or a link that is not understood.
"""

import argparse
import concurrent.futures
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NETNS = ROOT / "tests" / "interop" / "netns.sh"
INSIDE = "MR_DAMPER_GUIDE_INSIDE"
# Pages that root runs at the same time. Their commands mostly wait, but some fit models on all processors, and live ones must keep up.
TOGETHER = 2
LIMIT_S = 60.0
# A background program has this long to end after SIGINT.
END_S = 10.0
# No real damper is likely to be in this domain, and no other test of the project uses it.
DOMAIN = "91"
# The commands of the guide read these directories of the repository. Each page gets a copy.
COPIED = ("launch-configs", "node/examples")


class Bad(Exception):
    """A page that cannot be run."""


@dataclass
class Block:
    """A piece of a page that does something."""

    page: Path
    line: int
    kind: str  # run, background, skip, file
    text: str
    hidden: bool = False
    seconds: float = LIMIT_S
    detail: str = ""  # the reason of a skip, or the name of a file

    def title(self):
        if self.kind == "file":
            return f"(file) {self.detail}"
        first = next((line.strip() for line in self.text.splitlines() if line.strip()), "")
        return f"{'(setup) ' if self.hidden else ''}{first[:90]}"

    def place(self):
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def directive(page, line, text):
    """The block that the first line of a comment asks for, without its commands."""

    def block(kind, **more):
        return Block(page, line, kind, "", **more)

    if match := re.fullmatch(r"skip, (\S.*)", text):
        return block("skip", detail=match[1])
    if match := re.fullmatch(r"background (\d+) s", text):
        return block("background", seconds=float(match[1]))
    if match := re.fullmatch(r"limit (\d+) s", text):
        return block("run", seconds=float(match[1]))
    if match := re.fullmatch(r"file ([\w.-]+)", text):
        return block("file", detail=match[1])
    raise Bad(f"{page.relative_to(ROOT)}:{line}: unknown comment `run: {text}`; `{Path(__file__).name} --help` lists them")


def blocks_of(page):
    """The blocks of a page, in order."""
    found, pending, lines = [], None, page.read_text().splitlines()
    at = 0
    while at < len(lines):
        line, number = lines[at], at + 1
        at += 1
        if match := re.match(r"\s*<!-- run: setup *(.*)$", line):
            block = directive(page, number, match[1]) if match[1] else Block(page, number, "run", "")
            block.hidden, start = True, at
            while at < len(lines) and lines[at].strip() != "-->":
                at += 1
            block.text = "\n".join(lines[start:at]) + "\n"
            found.append(block)
            at += 1
        elif match := re.match(r"\s*<!-- run: (.*?) *-->\s*$", line):
            if pending:
                raise Bad(f"{pending.place()}: the comment is not in front of a block")
            pending = directive(page, number, match[1])
        elif match := re.match(r"(\s*)```(\w*)", line):
            indent, language, start = len(match[1]), match[2], at
            while at < len(lines) and lines[at].strip() != "```":
                at += 1
            text = "\n".join(text[indent:] for text in lines[start:at]) + "\n"
            at += 1
            if language == "sh" or (pending and pending.kind == "file"):
                block = pending or Block(page, number, "run", "")
                block.line, block.text = number, text
                found.append(block)
            elif pending:
                raise Bad(f"{pending.place()}: the comment is for a block of sh, not of {language or 'plain text'}")
            pending = None
        elif line.strip() and pending:
            raise Bad(f"{pending.place()}: the comment is not in front of a block")
    return found


class Page:
    """The scratch directory of a page and its background programs."""

    def __init__(self, binary):
        self.folder = Path(tempfile.mkdtemp(prefix="mr-damper-guide-"))
        self.running = []
        for name in COPIED:
            shutil.copytree(ROOT / name, self.folder / name)
        tools = self.folder / "bin"
        tools.mkdir()
        (tools / "mr-damper").symlink_to(binary)
        (self.folder / "target" / "release").mkdir(parents=True)
        (self.folder / "target" / "release" / "mr-damper").symlink_to(binary)
        self.env = {
            **os.environ,
            "PATH": f"{tools}:{os.environ['PATH']}",
            "ROS_DOMAIN_ID": DOMAIN,
            "HOME": str(self.folder),
            "TMPDIR": str(self.folder),
        }
        self.env.pop("ROS_AUTOMATIC_DISCOVERY_RANGE", None)

    def start(self, block):
        log = open(self.folder / f"log-{len(list(self.folder.glob('log-*')))}", "w+")
        command = ["bash", "-eu", "-c", block.text]
        child = subprocess.Popen(
            command, cwd=self.folder, env=self.env, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
        )
        return child, log

    def run(self, block):
        """Runs a block; the reason of a failure, or nothing."""
        if block.kind == "file":
            (self.folder / block.detail).write_text(block.text)
            return None
        child, log = self.start(block)
        try:
            code = child.wait(block.seconds)
        except subprocess.TimeoutExpired:
            if block.kind == "background":
                self.running.append((block, child, log))
                return None
            kill(child)
            return f"does not end within {block.seconds:.0f} s\n{tail(log)}"
        except BaseException:  # Ctrl-C
            kill(child)
            raise
        if code == 0 and block.kind != "background":
            return None
        return f"exit code {code}{' at once' if block.kind == 'background' else ''}\n{tail(log)}"

    def abort(self):
        for _, child, _ in self.running:
            if child.poll() is None:
                kill(child)
        shutil.rmtree(self.folder, ignore_errors=True)

    def close(self):
        """Ends the background programs, last one first, and removes the directory. Yields each block with the reason of a failure."""
        for block, child, log in reversed(self.running):
            ended_before = child.poll() is not None
            if not ended_before:
                os.killpg(child.pid, signal.SIGINT)
            try:
                code = child.wait(END_S)
            except subprocess.TimeoutExpired:
                kill(child)
                yield block, f"does not end within {END_S:.0f} s of SIGINT\n{tail(log)}"
                continue
            # bash reports the end of its last command, or its own by the signal.
            fine = code in (0, 130, -signal.SIGINT) and not ended_before
            yield block, None if fine else f"exit code {code}{', by itself' if ended_before else ''}\n{tail(log)}"
        shutil.rmtree(self.folder, ignore_errors=True)


def kill(child):
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()


def tail(log):
    log.seek(0)
    return "".join(f"    {line}" for line in log.readlines()[-15:])


def run_page(page, binary, report):
    blocks = blocks_of(page)
    if not blocks:
        return
    scratch = Page(binary)
    try:
        for block in blocks:
            if block.kind == "skip":
                report("skipped", block, 0.0, block.detail)
                continue
            began = time.monotonic()
            failure = scratch.run(block)
            if block.kind == "background" and failure is None:
                continue  # reported when it has ended
            report("failed" if failure else "passed", block, time.monotonic() - began, failure)
    except BaseException:
        scratch.abort()
        raise
    for block, failure in scratch.close():
        report("failed" if failure else "passed", block, block.seconds, failure)


def run_here(pages, binary):
    """Runs pages one after the other on this network; the number of blocks of each outcome."""
    counts = {"passed": 0, "failed": 0, "skipped": 0}

    def report(outcome, block, seconds, more):
        counts[outcome] += 1
        reason = f" ({more})" if outcome == "skipped" else ""
        print(f"{outcome:<8} {seconds:5.1f} s  {block.place()}: {block.title()}{reason}", flush=True)
        if outcome == "failed":
            print(more.rstrip(), flush=True)

    for page in pages:
        run_page(page, binary, report)
    return counts


def run_apart(page):
    """Runs a page by this script in a new network namespace, and prints its lines when it has ended; the number of blocks of each outcome."""
    command = [NETNS, "run", sys.executable, __file__, page.relative_to(ROOT)]
    done = subprocess.run(command, env={**os.environ, INSIDE: "1"}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    *lines, summary = done.stdout.splitlines() or [""]
    match = re.fullmatch(r"(\d+) passed, (\d+) failed, (\d+) skipped", summary)
    passed, failed, skipped = map(int, match.groups()) if match else (0, 0, 0)
    if done.returncode != 0 and not failed:
        lines += [summary, f"failed   {page.relative_to(ROOT)}: exit code {done.returncode}"]
        failed = 1
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    sys.stdout.flush()
    return {"passed": passed, "failed": failed, "skipped": skipped}


def run_together(pages):
    """Runs pages at the same time, each in its own network namespace."""
    with concurrent.futures.ThreadPoolExecutor(TOGETHER) as pool:
        counts = list(pool.map(run_apart, pages))
    return {outcome: sum(count[outcome] for count in counts) for outcome in ("passed", "failed", "skipped")}


def slug(heading):
    """The anchor of a heading, as GitHub and MkDocs make it."""
    text = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    return re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", text))


def dead_links():
    """Links of the documentation to files or headings that do not exist."""
    pages = [ROOT / "README.md", *sorted((ROOT / "node").glob("*.md")), *sorted((ROOT / "node" / "docs").rglob("*.md"))]
    plain = {page: re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(), flags=re.DOTALL) for page in pages}
    for page in pages:
        for target in re.findall(r"\]\(([^)\s]+)\)", plain[page]):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, anchor = target.partition("#")
            file = (page.parent / path).resolve() if path else page
            if not file.exists():
                yield f"{page.relative_to(ROOT)}: {target}: there is no {path}"
            elif anchor and file.suffix == ".md":
                text = re.sub(r"```.*?```", "", file.read_text(), flags=re.DOTALL)
                if anchor not in {slug(heading) for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE)}:
                    yield f"{page.relative_to(ROOT)}: {target}: there is no heading of that name"


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", nargs="*", help="pages to run")
    parser.add_argument("--list", action="store_true", help="list the blocks and run nothing")
    return parser.parse_args()


def main():
    arguments = parse_arguments()
    guide = sorted((ROOT / "node" / "docs" / "guide").glob("*.md"))
    pages = [(ROOT / page).resolve() for page in arguments.page] or [ROOT / "README.md", *guide]
    binary = Path(os.environ.get("MR_DAMPER_BIN", ROOT / "target" / "release" / "mr-damper")).resolve()
    blocks = {page: blocks_of(page) for page in pages}
    if arguments.list:
        for block in (block for page in pages for block in blocks[page]):
            print(f"{block.kind:<10} {block.place()}: {block.title()}")
        return 0
    if not os.access(binary, os.X_OK):
        raise Bad(f"{binary} is not there: cargo build --release --workspace --bins, or set MR_DAMPER_BIN")
    dead = [] if arguments.page else list(dead_links())
    for link in dead:
        print(f"dead link: {link}", flush=True)
    apart = os.getuid() == 0 and INSIDE not in os.environ
    counts = run_together(pages) if apart else run_here(pages, binary)
    print(", ".join(f"{count} {outcome}" for outcome, count in counts.items()))
    return 2 if dead and not counts["failed"] else int(counts["failed"] > 0)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Bad as bad:
        print(f"{Path(__file__).name}: {bad}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
