"""Compares the CAN frames that mr-damper sends with those of other encoders, on random signals and values.

usage: can_outputs.py OUTPUTS
       OUTPUTS: the program of `cargo build --workspace --examples`

Needs the packages of .ci/bus.txt. cantools encodes each value in a message of the same DBC file: signals of any place and length, in both
byte orders, unsigned, signed and float, with factors, offsets and ranges. A value that cantools refuses must be marked as one that the
signal cannot carry. The reserved patterns (`not available`) are values for cantools; they are counted. Frames with counter and checksum
are checked by autosar-e2e (profile 1) and crccheck (SAE J1850). The exit code is 1 if anything differs.
"""

import random
import struct
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import cantools
import e2e.p01
from crccheck.crc import Crc8SaeJ1850

MESSAGES = 2000
VALUES = 10
FACTORS = ["1", "0.5", "0.01", "0.1", "-1", "-0.25", "3", "10", "0.001", "1.7", "7e-4"]
OFFSETS = ["0", "0", "-40", "0.5", "1000", "-1e-3"]


def bits(value):
    """The bits of the double, as 16 hexadecimal digits."""
    return struct.pack(">d", value).hex()


def room(start, big_endian):
    """Number of bits from the first one to the end of 8 bytes."""
    return 64 - (start // 8 * 8 + 7 - start % 8) if big_endian else 64 - start


def message(index, chance):
    """The text of a message with one signal, and values for it."""
    big_endian, kind = chance.random() < 0.5, chance.choice(["+", "-", "-", "float", "double"])
    factor, offset = chance.choice(FACTORS), chance.choice(OFFSETS)
    while True:
        start = chance.randrange(64)
        length = {"float": 32, "double": 64}.get(kind) or chance.randint(1, 64)
        if length <= room(start, big_endian):
            break
    if kind in ("float", "double"):
        low, high = -1e6, 1e6
    else:
        low = -(2 ** (length - 1)) if kind == "-" else 0
        high = low + 2**length - 1
    ends = sorted(float(raw) * float(factor) + float(offset) for raw in (low, high))
    span = ends[1] - ends[0]
    limits = sorted(chance.uniform(*ends) for _ in range(2)) if chance.random() < 0.3 and length < 50 else [0, 0]
    sign = "+" if kind == "+" else "-"
    text = f'BO_ {index + 1} M{index}: 8 X\n SG_ S : {start}|{length}@{0 if big_endian else 1}{sign} ({factor},{offset}) [{limits[0]!r}|{limits[1]!r}] "N" X\n'
    if kind in ("float", "double"):
        text += f"SIG_VALTYPE_ {index + 1} S : {1 if kind == 'float' else 2};\n"
    values = [chance.uniform(ends[0] - 0.1 * span, ends[1] + 0.1 * span) for _ in range(VALUES - 4)]
    # The ends, and halves between two steps, which are rounded to the even one.
    middle = (low + high) // 2
    values += [*ends, (middle + 0.5) * float(factor) + float(offset), (middle + 1.5) * float(factor) + float(offset)]
    return text, values


def run(program, dbc, lines):
    """The answers of the program to lines."""
    done = subprocess.run([program, dbc], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def compare(program, folder, counts):
    """Compares single signals with cantools."""
    chance = random.Random(1)
    cases = [message(index, chance) for index in range(MESSAGES)]
    dbc = folder / "random.dbc"
    dbc.write_text('VERSION ""\nBU_: X\n' + "".join(text for text, _ in cases if not text.startswith("SIG")), encoding="ascii")
    database = cantools.database.load_file(dbc)
    lines = [f"force_estimate=M{index},force=S\t{bits(value)}" for index, (_, values) in enumerate(cases) for value in values]
    found = iter(run(program, dbc, lines))
    for index, (text, values) in enumerate(cases):
        of = database.get_message_by_name(f"M{index}")
        signal = of.signals[0]
        for value in values:
            ours = next(found)
            try:
                theirs = of.encode({"S": value}, strict=True).hex()
            except Exception:
                counts["values that cantools refuses"] += 1
                counts["differences"] += not ours.startswith("!")
                continue
            if ours.startswith("!"):
                # The pattern is sent, which is what cantools sends for the reserved value only.
                counts["reserved values"] += 1
                is_same = ours[1:] == theirs
            else:
                counts["values"] += 1
                is_same = ours == theirs
            if not is_same:
                counts["differences"] += 1
                print(f"{text.splitlines()[1].strip()}: {value!r} ({signal.length} bits): cantools {theirs}, mr-damper {ours}")


PROTECTED = '''VERSION ""
BU_: X
BO_ 1 P1: 8 X
 SG_ Crc : 0|8@1+ (1,0) [0|0] "" X
 SG_ Alive : 8|4@1+ (1,0) [0|0] "" X
 SG_ Validity : 12|3@1+ (1,0) [0|0] "" X
 SG_ Force : 16|32@1- (0.01,0) [0|0] "N" X
BO_ 2 J: 12 X
 SG_ Force : 7|32@0- (0.01,0) [0|0] "N" X
 SG_ Alive : 60|4@1+ (1,0) [0|0] "" X
 SG_ Crc : 95|8@0+ (1,0) [0|0] "" X
'''


def protected(program, folder, counts):
    """Checks counters and checksums."""
    chance = random.Random(2)
    dbc = folder / "protected.dbc"
    dbc.write_text(PROTECTED, encoding="ascii")
    forces = [chance.uniform(-1e4, 1e4) for _ in range(1000)]
    for data_id in (0x123, 0, 0xFFFF):
        text = f"force_estimate=P1,force=Force,validity=Validity,counter=Alive,checksum=Crc,data_id={data_id}"
        for index, line in enumerate(run(program, dbc, [f"{text}\t{bits(force)}" for force in forces])):
            data = bytearray.fromhex(line)
            counts["frames of profile 1"] += 1
            counts["differences"] += not (e2e.p01.e2e_p01_check(data, data_id) and data[1] & 15 == index % 15)
    text = "force_estimate=J,force=Force,counter=Alive,checksum=Crc"
    for index, line in enumerate(run(program, dbc, [f"{text}\t{bits(force)}" for force in forces])):
        data = bytes.fromhex(line)
        counts["frames of SAE J1850"] += 1
        counts["differences"] += not (Crc8SaeJ1850.calc(data[:11]) == data[11] and data[7] >> 4 == index % 16)


def main():
    program = sys.argv[1]
    counts = Counter({"differences": 0})
    with tempfile.TemporaryDirectory() as folder:
        compare(program, Path(folder), counts)
        protected(program, Path(folder), counts)
    for what, count in counts.items():
        print(f"{count:10} {what}")
    sys.exit(1 if counts["differences"] else 0)


if __name__ == "__main__":
    main()
