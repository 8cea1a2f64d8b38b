"""Compares signals of J1939 messages, and frames in several groups of an MDF4 file, with what cantools and asammdf give.

usage: bus_j1939.py SIGNALS
       SIGNALS: the program of `cargo build -p mr-damper-runs --example signals`

Needs the packages of .ci/bus.txt. DBC files with random messages mark some of them as J1939, each message by its attribute or by the default.
Frames have random priorities, source addresses and destinations; each message has one sender. The reference takes `message.protocol` of
cantools, compares the PGN of `cantools.j1939` or else the identifier, and decodes with cantools. The same frames are written by asammdf as an
MDF4 file with three groups that take turns. Times and values are compared bit by bit. The exit code is 1 if a sample differs.
"""

import random
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import asammdf
import cantools
import numpy as np
from asammdf.blocks.source_utils import Source
from cantools import j1939

FORMATS = ["StandardCAN", "ExtendedCAN", "reserved", "J1939PG"]
STEPS = 600
RECORD = [
    ("CAN_DataFrame.BusChannel", "<u1"),
    ("CAN_DataFrame.ID", "<u4"),
    ("CAN_DataFrame.IDE", "<u1"),
    ("CAN_DataFrame.DLC", "<u1"),
    ("CAN_DataFrame.DataLength", "<u1"),
    ("CAN_DataFrame.DataBytes", "(8,)u1"),
]


def pgn(identifier):
    """The PGN by cantools, without the destination of PDU1."""
    parts = j1939.frame_id_unpack(identifier)
    specific = parts.pdu_specific if parts.pdu_format >= 240 else 0
    return j1939.pgn_pack(parts.reserved, parts.data_page, parts.pdu_format, specific)


def identifier(chance, group):
    """An identifier of this PGN with another priority, source address and destination."""
    low = chance.randrange(256) << 8 if group >> 8 & 0xFF < 240 else 0
    return chance.randrange(8) << 26 | group << 8 | low | chance.randrange(254)


def with_priority(chance, value):
    return value & 0x03FFFFFF | chance.randrange(8) << 26


def dbc(chance):
    """A DBC file with random messages of different PGNs."""
    groups = chance.sample(range(0, 0x1FFFF), 12)
    groups = sorted({group & ~0xFF if group >> 8 & 0xFF < 240 else group for group in groups})
    lines = ['VERSION ""', "BU_: ECU", 'BA_DEF_ BO_ "VFrameFormat" ENUM ' + ",".join(f'"{name}"' for name in FORMATS) + ";"]
    lines.append(f'BA_DEF_DEF_ "VFrameFormat" "{chance.choice(["J1939PG", "ExtendedCAN"])}";')
    ids = [identifier(chance, group) | 1 << 31 for group in groups]
    for index, marked in enumerate(ids):
        lines += [f"BO_ {marked} M{index}: 8 ECU", f' SG_ S : {chance.randrange(40)}|16@1- (0.1,-3) [0|0] "m" ECU']
    lines += [f'BA_ "VFrameFormat" BO_ {marked} {chance.choice([1, 3])};' for marked in ids if chance.random() < 0.6]
    return "\n".join(lines) + "\n"


def frames(chance, database):
    """Frames of each message from one sender. Half of the messages that are not of J1939 have frames with their identifier."""
    senders = {}
    for message in database.messages:
        other = identifier(chance, pgn(message.frame_id))
        senders[message.name] = message.frame_id if message.protocol != "j1939" and chance.random() < 0.5 else other
    for k in range(STEPS):
        message = chance.choice(database.messages)
        used = with_priority(chance, senders[message.name]) if message.protocol == "j1939" else senders[message.name]
        yield k * 1000 + 7, used, chance.randbytes(8)


def reference(database, all_frames):
    """The samples of each message, as (time in ns, bits of the value)."""
    found = {message.name: [] for message in database.messages}
    for micros, used, data in all_frames:
        exact = [message for message in database.messages if message.frame_id == used]
        same = [message for message in database.messages if message.protocol == "j1939" and pgn(message.frame_id) == pgn(used)]
        for message in (exact or same)[:1]:
            value = message.decode(data, decode_choices=False)["S"]
            found[message.name].append((micros * 1000, struct.pack(">d", float(value)).hex()))
    return found


def candump(path, all_frames):
    lines = [f"({micros // 10**6}.{micros % 10**6:06}) can0 {used:08X}#{data.hex().upper()}\n" for micros, used, data in all_frames]
    path.write_text("".join(lines), encoding="ascii")


def mdf4(path, all_frames):
    """An MDF4 file with three groups of one bus that take turns."""
    mdf = asammdf.MDF(version="4.10")
    source = Source("CAN1", "CAN1", "", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
    for part in range(3):
        own = all_frames[part::3]
        records = np.array([(1, used, 1, 8, 8, list(data)) for _, used, data in own], dtype=RECORD)
        times = np.array([micros / 1e6 for micros, _, _ in own])
        mdf.append(asammdf.Signal(records, times, name="CAN_DataFrame", source=source), acq_name="CAN", acq_source=source)
    mdf.save(path, overwrite=True)
    mdf.close()


def ours(program, dbc_file, log, names):
    """The samples that mr-damper reads; empty for a message without frames."""
    done = subprocess.run([program, dbc_file, log], input="".join(f"{name}.S\n" for name in names), capture_output=True, text=True, check=True)
    found = {name: [] for name in names}
    for line in done.stdout.splitlines():
        name, time, *bits = line.split("\t")
        if time == "!":
            if "no frame of" not in line:
                raise SystemExit(line)
            continue
        found[name.split(".")[0]].append((int(time), bits[0]))
    return found


def main():
    (program,) = sys.argv[1:]
    failed = False
    samples = j1939_messages = 0
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for seed in range(40):
            chance = random.Random(seed)
            dbc_file = folder / "car.dbc"
            dbc_file.write_text(dbc(chance), encoding="ascii")
            database = cantools.database.load_file(dbc_file)
            all_frames = list(frames(chance, database))
            expected = reference(database, all_frames)
            for name, writer in (("run.log", candump), ("run.mf4", mdf4)):
                writer(folder / name, all_frames)
                found = ours(program, dbc_file, folder / name, list(expected))
                wrong = [message for message in expected if found[message] != expected[message]]
                failed |= bool(wrong)
                if wrong:
                    print(f"DIFFERS  seed {seed}, {name}: {', '.join(wrong)}")
            samples += sum(len(all_samples) for all_samples in expected.values())
            j1939_messages += sum(message.protocol == "j1939" for message in database.messages)
    print(f"{'DIFFERS' if failed else 'same'}  {samples} samples, {j1939_messages} messages of J1939")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
