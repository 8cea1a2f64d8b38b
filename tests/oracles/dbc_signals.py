"""Compares the signals that mr-damper decodes with those of cantools, for all messages of DBC files on random frames.

usage: dbc_signals.py SIGNALS FILE.dbc...
       SIGNALS: the program of `cargo build -p mr-damper-runs --example signals`

Needs the packages of .ci/bus.txt. Each message gets 20 frames of random bytes and full length, in a log as candump writes it; its
multiplexers get values that the file knows. Values are compared bit by bit: `raw * factor + offset` in double, as cantools computes it.
Messages that cantools refuses in strict mode (signals that overlap or leave the message) are left out, and so are signals that cantools
never selects and values that are not finite; all of them are counted. The exit code is 1 if a value differs, or if one of the two gives a value that the other does not.
"""

import math
import random
import struct
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import cantools

FRAMES = 20


def bits(value):
    """The bits of the double, as 16 hexadecimal digits."""
    return struct.pack(">d", float(value)).hex()


def set_raw(data, signal, raw):
    """`data` with the raw value of a signal, bit by bit."""
    out = bytearray(data)
    place = signal.start
    for index in range(signal.length):
        if signal.byte_order == "little_endian":
            bit = raw >> index & 1
        else:
            bit = raw >> (signal.length - 1 - index) & 1
        out[place // 8] = out[place // 8] & ~(1 << place % 8) | bit << place % 8
        if signal.byte_order == "little_endian":
            place += 1
        else:
            place = place + 15 if place % 8 == 0 else place - 1
    return bytes(out)


def frame(message, chance):
    """Random data in which each multiplexer selects signals of the file."""
    data = chance.randbytes(message.length)
    for signal in message.signals:
        if signal.is_multiplexer:
            ids = sorted({i for other in message.signals if other.multiplexer_signal == signal.name for i in other.multiplexer_ids or []})
            if ids:
                data = set_raw(data, signal, chance.choice(ids))
    return data


def usable(database):
    """The messages that cantools accepts in strict mode, and the number of the others."""
    good, bad = [], 0
    for message in database.messages:
        try:
            message.refresh(strict=True)
        except Exception:
            bad += 1
            message.refresh(strict=False)
            continue
        if message.is_container or message.length > 64:
            bad += 1
        elif message.length:
            good.append(message)
    return good, bad


def is_selected(message, signal):
    """False if cantools never gives the signal a value: its multiplexer is marked with `m` alone, and cantools does not follow it."""
    multiplexer = signal.multiplexer_signal
    return multiplexer is None or message.get_signal_by_name(multiplexer).is_multiplexer


def compare(program, path, counts, folder):
    """Compares the values of one file; returns descriptions of the differences."""
    chance = random.Random(path.name)
    try:
        database = cantools.database.load_file(path, strict=False, database_format="dbc")
    except Exception as error:
        counts["files that cantools refuses"] += 1
        print(f"{path}: cantools refuses it: {str(error).splitlines()[0] if str(error) else error!r}")
        return []
    messages, left = usable(database)
    counts["messages left out"] += left
    wanted, lines, names, nanos = {}, [], [], 0
    for message in messages:
        selected = [signal for signal in message.signals if is_selected(message, signal)]
        counts["signals that cantools never selects"] += len(message.signals) - len(selected)
        names += [f"{message.name}.{signal.name}" for signal in selected]
        for _ in range(FRAMES):
            data = frame(message, chance)
            try:
                values = message.decode(data, decode_choices=False, allow_truncated=False)
            except Exception:
                # A chain of multiplexers selects a value that the file does not know.
                counts["frames that cantools refuses"] += 1
                continue
            nanos += 1_000
            identifier = f"{message.frame_id:08X}" if message.is_extended_frame else f"{message.frame_id:03X}"
            kind = "##0" if message.length > 8 else "#"
            lines.append(f"({nanos // 10**9}.{nanos % 10**9:09d}) can0 {identifier}{kind}{data.hex().upper()}")
            for name, value in values.items():
                if math.isfinite(float(value)):
                    wanted[f"{message.name}.{name}", nanos] = bits(value)
                else:
                    counts["values that are not finite"] += 1
    if not lines:
        counts["files without a message"] += 1
        return []
    log = Path(folder) / "frames.log"
    log.write_text("\n".join(lines) + "\n", encoding="ascii")
    done = subprocess.run([program, path, log], input="\n".join(dict.fromkeys(names)), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return [f"{path}: {done.stderr.strip()}"]
    found, refused = {}, {}
    for line in done.stdout.splitlines():
        name, stamp, value = line.split("\t", 2)
        if stamp == "!":
            refused[name] = value
        else:
            found[name, int(stamp)] = value
    counts["files"] += 1
    counts["messages"] += len(messages)
    counts["signals"] += len(set(names))
    counts["values"] += len(wanted)
    differing = [f"{path}: {name} at {stamp}: cantools {value}, mr-damper {found.get((name, stamp), refused.get(name, 'no value'))}"
                 for (name, stamp), value in wanted.items() if found.get((name, stamp)) != value]
    differing += [f"{path}: {name} at {stamp}: cantools no value, mr-damper {value}" for (name, stamp), value in found.items() if (name, stamp) not in wanted]
    counts["values that differ"] += len(differing)
    return differing


def main():
    program, *paths = sys.argv[1:]
    counts = Counter({"values that differ": 0})
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        for path in sorted(map(Path, paths)):
            differing = compare(program, path, counts, folder)
            failed |= bool(differing)
            for line in differing[:5]:
                print(line)
    for what, count in counts.items():
        print(f"{count:10} {what}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
