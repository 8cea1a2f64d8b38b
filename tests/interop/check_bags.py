#!/usr/bin/env python3
"""Checks our rosbag2 bags with two independent implementations, `rosbags` and `mcap` + `mcap-ros2-support`.

    python3 -m venv /tmp/bag-venv
    /tmp/bag-venv/bin/pip install rosbags mcap mcap-ros2-support

To check that both open a bag written by us (a directory, or one of its files) and find exactly the columns of a CSV file, with
bit-identical values and stamps equal to the nanosecond, and that `metadata.yaml` describes each file correctly. `mcap` reads only
MCAP, `rosbags` also sqlite3:

    mr-damper convert RUN.csv BAG --storage sqlite3 --max-bag-duration 1
    /tmp/bag-venv/bin/python tests/interop/check_bags.py BAG RUN.csv

To write bags with `rosbags` from a CSV file, for us to read: OUT/v8 and OUT/v9 in MCAP, OUT/sqlite, and compressed bags of both
storages, by file and by message. OUT/humble is OUT/sqlite in the schema of Humble, without definitions and hashes:

    /tmp/bag-venv/bin/python tests/interop/check_bags.py --write OUT RUN.csv
    mr-damper convert OUT/v8 BACK.csv        # must equal RUN.csv in its canonical form

To write bags with `rosbags` whose topics have their own names and types, with the messages of two distributions:
OUT/foreign-humble and OUT/foreign-jazzy. They are read with the map given at FOREIGN:

    /tmp/bag-venv/bin/python tests/interop/check_bags.py --write-foreign OUT RUN.csv

The CSV file must be in SI columns, as `mr-damper convert` writes them. Exit code 0 means that everything is equal;
differences go to stderr with exit code 1.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import sqlite3
import sys
from decimal import Decimal
from pathlib import Path

import numpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from ruamel.yaml import YAML

# Column: (topic, type, field with the value).
TOPICS = {
    "displacement_m": ("/displacement", "mr_damper_msgs/msg/Displacement", "displacement"),
    "velocity_m_s": ("/velocity", "mr_damper_msgs/msg/Velocity", "velocity"),
    "force_n": ("/measured_force", "mr_damper_msgs/msg/Force", "force"),
    "current_a": ("/coil_current", "mr_damper_msgs/msg/CoilCurrent", "current"),
    "command_v": ("/command_voltage", "mr_damper_msgs/msg/CommandVoltage", "voltage"),
    "case_temp_c": ("/case_temperature", "sensor_msgs/msg/Temperature", "temperature"),
    "ambient_temp_c": ("/ambient_temperature", "sensor_msgs/msg/Temperature", "temperature"),
}


def topic_of(column: str) -> tuple[str, str, str]:
    """Topic, type and field of a column; unknown columns are plain numbers below /other."""
    return TOPICS.get(column, (f"/other/{column}", "std_msgs/msg/Float64", "data"))


def read_csv(path: Path) -> dict[str, list[tuple[int, float]]]:
    """The columns of a CSV file, as (nanoseconds, value); times are exact, without conversion to float."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.reader(file)
        _, *names = next(rows)
        columns: dict[str, list[tuple[int, float]]] = {name: [] for name in names}
        for time, *cells in rows:
            nanos = int((Decimal(time) * 1_000_000_000).to_integral_value())
            for name, cell in zip(names, cells, strict=True):
                if cell:
                    columns[name].append((nanos, float(cell)))
    return columns


def stamp_of(message: object, log_time: int) -> int:
    """The header's stamp, or the log time for messages without a header."""
    if hasattr(message, "header"):
        return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    return log_time


def by_rosbags(bag: Path) -> dict[str, list[tuple[int, float]]]:
    """Samples by topic as `rosbags` reads them, with the definitions in the bag itself."""
    found: dict[str, list[tuple[int, float]]] = {}
    with AnyReader([bag]) as reader:
        fields = {c.topic: last_field(c.msgtype) for c in reader.connections}
        for connection, log_time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            pair = stamp_of(message, log_time), getattr(message, fields[connection.topic])
            found.setdefault(connection.topic, []).append(pair)
        for connection in reader.connections:
            # The hashes in the bag must equal the hashes that rosbags computes from the definitions.
            expected = reader.typestore.hash_rihs01(connection.msgtype)
            # In a bare MCAP file, rosbags does not look for them.
            if connection.digest != expected and (connection.digest or bag.suffix != ".mcap"):
                message = f"type hash {connection.digest}, rosbags computes {expected}"
                raise SystemExit(f"{connection.topic}: {message}")
    return found


def by_mcap(bag: Path) -> dict[str, list[tuple[int, float]]]:
    """Samples by topic as `mcap` and `mcap-ros2-support` read them."""
    found: dict[str, list[tuple[int, float]]] = {}
    for path in [bag] if bag.is_file() else sorted(bag.glob("*.mcap")):
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for schema, channel, record, message in reader.iter_decoded_messages():
                pair = stamp_of(message, record.log_time), getattr(message, last_field(schema.name))
                found.setdefault(channel.topic, []).append(pair)
    return found


def last_field(type_name: str) -> str:
    """The field with the value, by type."""
    return next((field for _, kind, field in TOPICS.values() if kind == type_name), "data")


def bits(value: float) -> str:
    """An exact text of a number, which also distinguishes -0.0 from 0.0."""
    return float(value).hex()


def check(bag: Path, source: Path) -> int:
    """Compares both views of a bag with a CSV file; returns the number of differences."""
    columns = {topic_of(name)[0]: samples for name, samples in read_csv(source).items()}
    faults = check_metadata(bag) if bag.is_dir() else 0
    readers = [("rosbags", by_rosbags)]
    if bag.suffix == ".mcap" or any(bag.glob("*.mcap")):
        readers.append(("mcap", by_mcap))
    for reader, read in readers:
        found = read(bag)
        for topic in sorted(columns.keys() | found.keys()):
            want = [(t, bits(v)) for t, v in columns.get(topic, [])]
            have = [(t, bits(v)) for t, v in found.get(topic, [])]
            if want != have:
                faults += 1
                unequal = (i for i, (a, b) in enumerate(zip(want, have)) if a != b)
                at = next(unequal, min(len(want), len(have)))
                print(
                    f"{reader}: {topic}: {len(want)} samples in CSV, {len(have)} in the bag; the first "
                    f"difference at {at}: {want[at:at + 1]} against {have[at:at + 1]}",
                    file=sys.stderr,
                )
        total = sum(len(samples) for samples in found.values())
        print(f"{reader}: {len(found)} topics, {total} messages compared")
    return faults


def check_metadata(bag: Path) -> int:
    """Compares metadata.yaml, for the bag and for each file, with the files; returns the number of differences."""
    told = YAML(typ="safe").load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    names = [file["path"] for file in told["files"]]
    unlike = [("file names", told["relative_file_paths"], names)]
    here = sorted(path.name for path in bag.iterdir() if path.name != "metadata.yaml")
    unlike.append(("files in the directory", here, sorted(names)))
    with Reader(bag) as reader:
        stamps = [timestamp for _, timestamp, _ in reader.messages()]
        counts = [connection.msgcount for connection in reader.connections]
        unlike.append(("message counts", [reader.message_count, sum(counts)], [len(stamps)] * 2))
        unlike.append(("start and end", [reader.start_time, reader.end_time], [min(stamps), max(stamps) + 1]))
    packed = told["compression_mode"] == "FILE"
    unlike.append(("packed names", {name.endswith(".zstd") for name in names}, {packed}))
    for file in [] if packed else told["files"]:
        with Reader(bag / file["path"]) as reader:
            start = file["starting_time"]["nanoseconds_since_epoch"]
            said = [file["message_count"], start, start + file["duration"]["nanoseconds"] + 1]
            unlike.append((file["path"], said, [reader.message_count, reader.start_time, reader.end_time]))
    unlike = [(what, said, found) for what, said, found in unlike if said != found]
    for what, said, found in unlike:
        print(f"metadata.yaml: {what}: it says {said}, the bag has {found}", file=sys.stderr)
    print(f"metadata.yaml: {len(names)} files")
    return len(unlike)


# Name of a bag: rosbag2's version, storage, and compression mode.
FORMS = {
    "v8": (8, StoragePlugin.MCAP, CompressionMode.NONE),
    "v9": (9, StoragePlugin.MCAP, CompressionMode.NONE),
    "sqlite": (8, StoragePlugin.SQLITE3, CompressionMode.NONE),
    "mcap-file": (9, StoragePlugin.MCAP, CompressionMode.FILE),
    "mcap-message": (9, StoragePlugin.MCAP, CompressionMode.MESSAGE),
    "mcap-storage": (9, StoragePlugin.MCAP, CompressionMode.STORAGE),
    "sqlite-file": (9, StoragePlugin.SQLITE3, CompressionMode.FILE),
    "sqlite-message": (9, StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
}


def make_humble(bag: Path, out: Path) -> None:
    """Writes a sqlite3 bag in the form of Humble."""
    shutil.copytree(bag, out)
    (database,) = out.glob("*.db3")
    with sqlite3.connect(database) as connection:
        connection.execute("DROP TABLE message_definitions")
        connection.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
        connection.execute("UPDATE schema SET schema_version = 3, ros_distro = 'humble'")
    connection.close()
    yaml = YAML(typ="safe")
    text = yaml.load((out / "metadata.yaml").read_text())
    told = text["rosbag2_bagfile_information"]
    told["version"] = 5
    for key in ("custom_data", "ros_distro"):
        del told[key]
    for topic in told["topics_with_message_count"]:
        del topic["topic_metadata"]["type_description_hash"]
    with (out / "metadata.yaml").open("w") as file:
        yaml.dump(text, file)


def write(out: Path, source: Path) -> None:
    """Writes the columns of a CSV file as bags in all forms."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted((Path(__file__).parents[2] / "msgs" / "msg").glob("*.msg")):
        store.register(get_types_from_msg(path.read_text(), f"mr_damper_msgs/msg/{path.stem}"))
    columns = read_csv(source)
    never = QosTime(9223372036, 854775807)
    qos = Qos(
        QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, QosDurability.VOLATILE, never, never,
        QosLiveliness.AUTOMATIC, never, avoid_ros_namespace_conventions=False,
    )  # fmt: skip
    time_type, header_type = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    for form, (version, storage, compression) in FORMS.items():
        bag = Writer(out / form, version=version, storage_plugin=storage)
        bag.set_compression(compression, CompressionFormat.ZSTD)
        with bag as writer:
            samples = []
            for index, name in enumerate(columns):
                topic, kind, field = topic_of(name)
                connection = writer.add_connection(topic, kind, typestore=store, offered_qos_profiles=[qos])
                for nanos, value in columns[name]:
                    samples.append((nanos, index, connection, kind, field, value))
            for nanos, _, connection, kind, field, value in sorted(samples, key=lambda sample: sample[:2]):
                fields: dict[str, object] = {field: value}
                if field != "data":
                    stamp = time_type(*divmod(nanos, 1_000_000_000))
                    fields |= {"header": header_type(stamp, "damper"), "variance": 0.0}
                message = store.types[kind](**fields)
                writer.write(connection, nanos, store.serialize_cdr(message, kind))
        print(f"{out / form}: {len(columns)} topics, {len(samples)} messages written")
    make_humble(out / "sqlite", out / "humble")


# Column: (topic, type). `mr-damper` reads these topics with --map
# displacement=/joint_states:fl_damper,sign=-1 measured_force=/load_cell:z coil_current=/amps setpoint=/ray.
FOREIGN = {
    "displacement_m": ("/joint_states", "sensor_msgs/msg/JointState"),
    "force_n": ("/load_cell", "geometry_msgs/msg/WrenchStamped"),
    "current_a": ("/amps", "std_msgs/msg/Float64"),
    "setpoint_m": ("/ray", "sensor_msgs/msg/Range"),
}


def foreign_message(store: object, kind: str, nanos: int, value: float) -> object:
    """A message of a foreign topic; displacement has the opposite sign there."""
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(nanos, 1_000_000_000))
    header = types["std_msgs/msg/Header"](stamp, "damper")
    if kind == "std_msgs/msg/Float64":
        return types[kind](value)
    if kind == "sensor_msgs/msg/JointState":
        position, none = numpy.array([0.0, -value]), numpy.array([])
        return types[kind](header, ["wheel", "fl_damper"], position, none, none)
    if kind == "geometry_msgs/msg/WrenchStamped":
        vector, wrench = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Wrench"]
        return types[kind](header, wrench(vector(9.0, 9.0, value), vector(0.0, 0.0, 0.0)))
    # Range had no variance before Iron.
    variance = {"variance": 0.0} if "variance" in dict(store.fielddefs[kind][1]) else {}
    limits = {"field_of_view": 0.5, "min_range": 0.0, "max_range": 4.0}
    return types[kind](header=header, radiation_type=1, range=value, **limits, **variance)


def write_foreign(out: Path, source: Path) -> None:
    """Writes the columns of a CSV file to topics with their own names and types."""
    columns = read_csv(source)
    for name, stores, storage in [
        ("foreign-humble", Stores.ROS2_HUMBLE, StoragePlugin.SQLITE3),
        ("foreign-jazzy", Stores.ROS2_JAZZY, StoragePlugin.MCAP),
    ]:
        store = get_typestore(stores)
        with Writer(out / name, version=8, storage_plugin=storage) as writer:
            samples = []
            for column, (topic, kind) in FOREIGN.items():
                connection = writer.add_connection(topic, kind, typestore=store)
                samples += [(nanos, topic, connection, kind, value) for nanos, value in columns[column]]
            for nanos, _, connection, kind, value in sorted(samples, key=lambda sample: sample[:2]):
                message = foreign_message(store, kind, nanos, value)
                writer.write(connection, nanos, store.serialize_cdr(message, kind))
        print(f"{out / name}: {len(FOREIGN)} topics, {len(samples)} messages written")


def main() -> int:
    """Reads the command line."""
    plain = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=plain)
    parser.add_argument("bag", type=Path, help="the bag or its file; with --write, the directory for bags")
    parser.add_argument("csv", type=Path, help="the CSV file with the same data")
    parser.add_argument("--write", action="store_true", help="write bags instead of checking one")
    parser.add_argument("--write-foreign", action="store_true", help="write bags with other names and types")
    arguments = parser.parse_args()
    if arguments.write_foreign:
        write_foreign(arguments.bag, arguments.csv)
        return 0
    if arguments.write:
        write(arguments.bag, arguments.csv)
        return 0
    faults = check(arguments.bag, arguments.csv)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
