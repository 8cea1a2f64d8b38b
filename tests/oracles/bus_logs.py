"""Compares runs that mr-damper reads from logs of a CAN bus with what python-can, asammdf and cantools read from them, bit by bit.

usage: bus_logs.py MR_DAMPER

Needs the packages of .ci/bus.txt. python-can writes the same frames as candump, ASC, BLF and MDF4 logs: classic frames and CAN FD, 11
and 29 bits, Intel and Motorola, signed, floats and multiplexed signals. asammdf writes the frames and the channels as MDF4 files: the
channels as floats and as whole numbers with a conversion, and both not packed, and packed with deflate, zstd and LZ4, with and without a
transposition, in one block and in a list of blocks. Each log is read again by the library that wrote it, decoded by cantools,
and written as CSV. `mr-damper convert` of the log and of that CSV must give the same bytes. Then each log is cut: the rows before the cut must be
the same, and a warning must name the place. The exit code is 1 if something differs.
"""

import math
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import asammdf
import can
import cantools
import numpy as np

DBC = """VERSION ""
BU_: ECU
BO_ 288 SUSP_FL: 8 ECU
 SG_ Position : 0|16@1- (0.01,0.5) [0|0] "mm" ECU
 SG_ Page M : 16|8@1+ (1,0) [0|0] "" ECU
 SG_ Oil m1 : 24|16@1- (0.1,-40) [0|0] "degC" ECU
 SG_ Speed m2 : 31|12@0- (0.5,0) [0|0] "mm/s" ECU
BO_ 2566848513 RIG: 12 ECU
 SG_ Load : 7|32@0- (1,0) [0|0] "kN" ECU
 SG_ Coil : 32|64@1- (1,0) [0|0] "A" ECU
BO_ 1793 OTHER: 2 ECU
 SG_ Load : 0|16@1+ (1,0) [0|0] "rpm" ECU
SIG_VALTYPE_ 2566848513 Load : 1;
SIG_VALTYPE_ 2566848513 Coil : 2;
"""

# Channel of the run, signal, and the column with the signal's unit.
CHANNELS = [
    ("displacement", "SUSP_FL.Position", "displacement_mm"),
    ("case_temperature", "SUSP_FL.Oil", "case_temp_c"),
    ("velocity", "SUSP_FL.Speed", "velocity_mm_s"),
    ("measured_force", "RIG.Load", "force_kn"),
    ("coil_current", "RIG.Coil", "current_a"),
]


def frames(database, start_s):
    """Frames of three messages, at different microseconds."""
    susp, rig, other = (database.get_message_by_name(name) for name in ("SUSP_FL", "RIG", "OTHER"))
    for k in range(2000):
        t = k * 0.004
        page = 1 + k % 2
        values = {"Position": round(40 * math.sin(9 * t), 2) + 0.5, "Page": page}
        values |= {"Oil": 20 + 0.1 * (k % 300)} if page == 1 else {"Speed": 0.5 * (k % 900 - 450)}
        yield can.Message(timestamp=round(start_s + t, 6), arbitration_id=288, is_extended_id=False, channel=0, data=susp.encode(values, strict=False))
        data = rig.encode({"Load": 2 * math.tanh(5 * math.cos(9 * t)), "Coil": 1 + math.sin(t)}, strict=False)
        yield can.Message(timestamp=round(start_s + t + 0.000_317, 6), arbitration_id=rig.frame_id, is_extended_id=True, is_fd=True, channel=0, data=data)
        if k % 10 == 0:
            at = round(start_s + t + 0.001, 6)
            yield can.Message(timestamp=at, arbitration_id=0x701, is_extended_id=False, channel=1, data=other.encode({"Load": k}))
            yield can.Message(timestamp=round(at + 1e-6, 6), arbitration_id=0x120, is_extended_id=False, is_remote_frame=True, dlc=8, channel=0)


def table(path, database, messages):
    """Writes the decoded signals as CSV: one row for each time, empty cells where a signal has no sample."""
    with open(path, "w", encoding="ascii") as out:
        print("time_s", *(column for _, _, column in CHANNELS), sep=",", file=out)
        for time, message in messages:
            if message.is_remote_frame or message.is_error_frame:
                continue
            definition = database.get_message_by_frame_id(message.arbitration_id)
            values = definition.decode(bytes(message.data), decode_choices=False)
            row = []
            for _, signal, _ in CHANNELS:
                name, _, part = signal.partition(".")
                has = definition.name == name and part in values
                row.append(repr(float(values[part])) if has else "")
            if any(row):
                print(time, *row, sep=",", file=out)


def micros(reader):
    """Messages with their times as text; the writers round to microseconds at best."""
    return [(f"{message.timestamp:.9f}", message) for message in reader]


def of_mdf(path):
    """Messages of an MDF4 file with the times of its time channel."""
    with asammdf.MDF(path) as mdf:
        group = next(i for i, group in enumerate(mdf.groups) if group.channels[1].name == "CAN_DataFrame")
        times = [repr(float(time)) for time in mdf.get("CAN_DataFrame", group=group).timestamps]
    messages = [message for message in can.MF4Reader(path) if not message.is_remote_frame]
    assert len(times) == len(messages)
    return list(zip(times, messages))


class Checker:
    def __init__(self, program, folder):
        self.program, self.folder, self.failed = program, Path(folder), False

    def convert(self, source, name, *options):
        target = self.folder / name
        target.unlink(missing_ok=True)
        done = subprocess.run([self.program, "convert", source, target, "--drive", "current_a", *options], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SystemExit(f"{source}: exit code {done.returncode}: {done.stderr}")
        return target.read_text(encoding="ascii"), done.stderr

    def same(self, what, log, csv, *options):
        ours, _ = self.convert(log, "ours.csv", *options)
        theirs, _ = self.convert(csv, "theirs.csv")
        rows = len(ours.splitlines()) - 1
        self.say(what, ours == theirs and rows > 1000, f"{rows} rows, {sum(a != b for a, b in zip(ours.splitlines(), theirs.splitlines()))} differ")
        return ours

    def cut(self, what, log, whole, *options):
        """Cuts a log at three fifths."""
        part = log.with_name(f"cut{log.suffix}")
        data = log.read_bytes()
        part.write_bytes(data[: len(data) * 3 // 5 + 3])
        ours, warning = self.convert(part, "cut.csv", *options)
        rows, all_rows = ours.splitlines(), whole.splitlines()
        good = 0.3 * len(all_rows) < len(rows) < len(all_rows) and rows == all_rows[: len(rows)] and "read up to" in warning
        self.say(f"{what}, cut", good, f"{len(rows) - 1} rows are the first of {len(all_rows) - 1}")

    def say(self, what, good, detail):
        print(f"{'same' if good else 'DIFFERS'}  {what}: {detail}")
        self.failed |= not good


def version_of(compression):
    """The oldest version of the format that has this compression of asammdf: from 3 on, zstd and LZ4."""
    return "4.30" if compression > 2 else "4.10"


def zip_types(path):
    """The numbers of the methods of all packed blocks in a file."""
    data = Path(path).read_bytes()
    return {data[at + 26] for at in range(0, len(data) - 26, 8) if data.startswith(b"##DZ\0\0\0\0", at)}


def plain_mdf(path, columns, compression, block_bytes):
    """An MDF4 file with plain channels: a float with its unit, and raw whole numbers with a linear conversion."""
    mdf = asammdf.MDF(version=version_of(compression))
    mdf.configure(write_fragment_size=block_bytes)
    t = np.arange(8000) * 0.004
    raw = np.round(4000 * np.sin(9 * t)).astype("<i2")
    linear = {"a": 0.01, "b": 0.5}
    position = asammdf.Signal(raw, t, name="Stroke", unit="mm", conversion=linear, raw=True)
    mdf.append([position, asammdf.Signal(np.tanh(5 * np.cos(9 * t)), t, name="Load cell", unit="kN")], common_timebase=True)
    slow = t[::5] + 0.000_1
    mdf.append([asammdf.Signal((1 + np.sin(slow)).astype("<f4"), slow, name="Coil", unit="A")])
    mdf.save(path, overwrite=True, compression=compression)
    mdf.close()
    with asammdf.MDF(path) as again:
        stroke, load, coil = (again.get(name) for name in ("Stroke", "Load cell", "Coil"))
        rows = {}
        for signal, place in ((stroke, 0), (load, 1), (coil, 2)):
            for time, value in zip(signal.timestamps, signal.samples):
                rows.setdefault(float(time), ["", "", ""])[place] = repr(float(value))
    with open(columns, "w", encoding="ascii") as out:
        print("time_s,displacement_mm,force_kn,current_a", file=out)
        for time in sorted(rows):
            print(repr(time), *rows[time], sep=",", file=out)


def main():
    (program,) = sys.argv[1:]
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        checker, folder = Checker(program, folder), Path(folder)
        dbc = folder / "car.dbc"
        dbc.write_text(DBC, encoding="ascii")
        database = cantools.database.load_file(dbc)
        options = ["--dbc", dbc]
        for channel, signal, _ in CHANNELS:
            options += ["--map", f"{channel}={signal}"]
        csv = folder / "reference.csv"
        writers = {".log": can.CanutilsLogWriter, ".asc": can.ASCWriter, ".blf": can.BLFWriter}
        readers = {".log": can.CanutilsLogReader, ".asc": can.ASCReader, ".blf": can.BLFReader}
        for suffix, writer in writers.items():
            log = folder / f"run{suffix}"
            with writer(log) as out:
                if suffix == ".blf":
                    out.max_container_size = 4096
                for message in frames(database, 0.0):
                    out.on_message_received(message)
            table(csv, database, micros(readers[suffix](log)))
            whole = checker.same(f"python-can {suffix}", log, csv, *options)
            checker.cut(f"python-can {suffix}", log, whole, *options)
        # Times since 1970: those of candump are exact, those of BLF are closer than the double of python-can resolves.
        log = folder / "since1970.log"
        with can.CanutilsLogWriter(log) as out:
            for message in frames(database, 1_700_000_000.25):
                out.on_message_received(message)
        table(csv, database, [(f"{message.timestamp:.6f}", message) for message in can.CanutilsLogReader(log)])
        checker.same("python-can .log since 1970", log, csv, *options)
        log = folder / "since1970.blf"
        with can.BLFWriter(log) as out:
            for message in frames(database, 1_700_000_000.25):
                out.on_message_received(message)
        table(csv, database, micros(can.BLFReader(log)))
        ours, _ = checker.convert(log, "ours.csv", *options)
        theirs, _ = checker.convert(csv, "theirs.csv")
        pairs = [(a.split(",", 1), b.split(",", 1)) for a, b in zip(ours.splitlines()[1:], theirs.splitlines()[1:])]
        good = all(a[1] == b[1] and float(a[0]) == float(b[0]) for a, b in pairs) and len(pairs) > 1000
        checker.say("python-can .blf since 1970", good, f"{len(pairs)} rows, times are the same doubles")
        # MDF4.
        for compression in range(7):
            log = folder / f"bus{compression}.mf4"
            writer = can.MF4Writer(log, compression_level=min(compression, 2))
            for message in frames(database, round(writer._start_time, 3) + 1):
                writer.on_message_received(message)
            writer.stop()
            if compression > 2:
                # python-can writes version 4.10 only.
                with asammdf.MDF(log) as mdf, mdf.convert("4.30") as newer:
                    newer.save(log, overwrite=True, compression=compression)
            table(csv, database, of_mdf(log))
            checker.same(f"python-can .mf4, compression {compression}", log, csv, *options)
            # The number of a method in the file is one less than asammdf's; files that are not packed have none.
            expected = {compression - 1} if compression else set()
            checker.say(f"methods in {log.name}", zip_types(log) == expected, f"{zip_types(log)}")
            # asammdf packs the blocks of a list with transposed deflate only.
            for block_bytes in (30_000, 4 << 20) if compression in (0, 2) else (4 << 20,):
                log = folder / f"plain{compression}-{block_bytes}.mf4"
                plain_mdf(log, csv, compression, block_bytes)
                maps = ["--map", "displacement=Stroke", "--map", "measured_force=Load cell", "--map", "coil_current=Coil"]
                checker.same(f"asammdf .mf4 with plain channels, compression {compression}, blocks of {block_bytes} bytes", log, csv, *maps)
                checker.say(f"methods in {log.name}", zip_types(log) == expected, f"{zip_types(log)}")
        sys.exit(1 if checker.failed else 0)


if __name__ == "__main__":
    main()
