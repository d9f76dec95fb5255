"""ROS 2 bags, in MCAP or SQLite storage: any numeric field of a message. Needs the extra `mcap`.

A column is `TOPIC:FIELD`: `/joint_states:position[MCP]` (the element whose `name` is MCP), `/joint_states:effort[0]`,
`/wrench:wrench.force.z`, `/speed_command:data`. Definitions of messages come from the bag; older SQLite bags hold none,
and only the common types of `definitions` can be read from them.
"""

from __future__ import annotations

import io
import re
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.child import in_child
from exodrake.core.errors import InputError
from exodrake.core.files import is_folder, read_bytes
from exodrake.data.foreign.lerobot import joint_name
from exodrake.data.foreign.mapping import Column, Derived, Mapped, Track
from exodrake.data.formats.mcap import is_log

SEPARATOR = "=" * 80
TIME = """MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
HEADER = f"""MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{SEPARATOR}
{TIME}"""
DEFINITIONS = {
    "sensor_msgs/msg/JointState": f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{SEPARATOR}
{HEADER}""",
    "geometry_msgs/msg/WrenchStamped": f"""std_msgs/Header header
geometry_msgs/Wrench wrench
{SEPARATOR}
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{SEPARATOR}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{SEPARATOR}
{HEADER}""",
    "std_msgs/msg/Float64": "float64 data\n",
    "std_msgs/msg/Float32": "float32 data\n",
    "std_msgs/msg/Float64MultiArray": f"""std_msgs/MultiArrayLayout layout
float64[] data
{SEPARATOR}
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
{SEPARATOR}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
""",
}


MCAP, SQLITE = ".mcap", ".db3"
STATE = "sensor_msgs/msg/JointState"
COMMANDS = ("command", "cmd", "desired", "reference", "target", "goal", "setpoint")  # in the name of a topic
KINDS = {"position": "angle", "velocity": "angle_speed", "effort": "effort"}
Topic = tuple[str, int, list[str] | None]  # type, number of messages, fields; None: they cannot be decoded
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N m"}  # REP 103; a sliding joint is another matter


def is_bag(path: str | Path) -> bool:
    """Whether a path is a bag: a file of its storage, or a folder that holds such; a log of ours in MCAP is none."""
    return bool(bag_files(path))


def bag_files(path: str | Path) -> list[Path]:
    """Files of a bag, in order: `bag_10` after `bag_9`."""
    files = sorted(Path(path).iterdir(), key=by_number) if is_folder(path) else [Path(path)]
    return [file for file in files if file.name.lower().endswith((MCAP, SQLITE)) and not is_log(file)]


def by_number(file: Path) -> list[tuple[int, str]]:
    """Sorting key of a file's name, whose digits count as numbers."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"([0-9]{1,18})", file.name)]


def read_bag(path: str | Path, columns: Sequence[str], stamp: str) -> dict[str, Track]:
    """Column -> samples with their times [s] of a bag; a bag of several files as one."""
    parts = [called(read_tracks, file, list(columns), stamp) for file in bag_files(path)]
    for column in columns:
        if not any(len(part[column].time) for part in parts):
            raise InputError(
                f"{path}: no message on topic {column.partition(':')[0]!r} gives column {column!r}, which is empty"
            )
    return {
        column: Track(*(np.concatenate([getattr(p[column], key) for p in parts]) for key in ("time", "values")))
        for column in columns
    }


def topics_of(path: str | Path) -> dict[str, Topic]:
    """Topic -> type, number of messages, and numeric fields of its first message, as columns name them.

    The fields are None where the messages cannot be decoded.
    """
    found: dict[str, Topic] = {}
    for file in bag_files(path):
        for topic, (kind, count, fields) in called(list_topics, file).items():
            before = found.get(topic, (kind, 0, fields))
            found[topic] = kind, before[1] + count, before[2] or fields
    return found


def default_mapping(path: str | Path) -> Mapped:
    """Joint states by their names: positions as angles, or as commands where the topic's name says so.

    Raises:
        InputError: for a bag without joint states.
    """
    columns: dict[str, Column] = {}
    for topic, (kind, _, fields) in topics_of(path).items():
        if kind.replace("/msg/", "/") != STATE.replace("/msg/", "/"):
            continue
        commanded = any(word in topic.lower() for word in COMMANDS)
        for field in fields or ():
            what, _, joint = field.rstrip("]").partition("[")
            ours = f"{KINDS[what]}{'_ref' if commanded and what != 'velocity' else ''}_{joint_name(joint)}"
            found = Column(f"{topic}:{field}", ours, UNITS[what])
            if (other := columns.setdefault(ours, found)) is not found:
                raise InputError(
                    f"{path}: {other.foreign!r} and {found.foreign!r} are both {ours}; write a mapping file that takes "
                    "one of them"
                )
    if not columns:
        raise InputError(
            f"{path}: no topic of {STATE} with positions; write a mapping file (import without --out lists)"
        )
    starts = tuple(
        Derived(name.replace("angle_", "angle_start_", 1), name, take="first")
        for name in columns
        if name.startswith("angle_") and not name.startswith(("angle_ref_", "angle_speed_"))
    )
    first = next(iter(columns.values())).foreign
    steps = np.diff(read_bag(path, [first], "header")[first].time)
    period = float(f"{np.median(steps):.3g}") if len(steps) and np.median(steps) > 0.0 else None
    return Mapped(tuple(columns.values()), start=0.0, stamp="header", derived=starts, period=period)


def called(function: Any, file: Path, *arguments: Any) -> Any:
    """A reader's answer from the child process."""
    data = read_bytes(file)
    return in_child(function, data, str(file), *arguments, source=str(file), size=len(data))


def read_tracks(data: bytes, source: str, columns: Sequence[str], stamp: str) -> dict[str, Track]:
    """Column -> samples with their times [s]; stamp `log` is the recorder's time, `header` the message's own.

    InputError names the topic or field that is not there; a damaged bag; IDL definitions, which the reader lacks.
    """
    wanted: dict[str, list[str]] = {}
    for column in columns:
        topic, _, field = column.partition(":")
        if not field:
            raise InputError(f"{source}: column {column!r}: wanted TOPIC:FIELD, like '/joint_states:position[MCP]'")
        wanted.setdefault(topic, []).append(field)
    samples: dict[str, tuple[list[float], list[float]]] = {column: ([], []) for column in columns}
    for topic, _, message, log_time in messages(data, source, set(wanted)):
        time = _stamp(message, topic, source) if stamp == "header" else log_time * 1e-9
        for field in wanted[topic]:
            value = _field(message, field, f"{source}: topic {topic!r}")
            if value is not None:
                times, values = samples[f"{topic}:{field}"]
                times.append(time)
                values.append(value)
    return {column: Track(np.array(times), np.array(values)) for column, (times, values) in samples.items()}


def list_topics(data: bytes, source: str) -> dict[str, Topic]:
    """`topics_of` of one file, in this process."""
    found: dict[str, Topic] = {}
    for topic, kind, message, _ in messages(data, source, None):
        _, count, fields = found.get(topic, (kind, 0, None))
        found[topic] = kind, count + 1, fields_of(message) if fields is None and message is not None else fields
    return found


def fields_of(message: Any, path: str = "") -> list[str]:
    """Numeric fields of a message, elements by its `name` list where it has one."""
    found: list[str] = []
    for name in getattr(message, "__slots__", None) or vars(message):
        value = getattr(message, name)
        here = f"{path}.{name}" if path else name
        if isinstance(value, bool | int | float):
            found.append(here)
        elif hasattr(value, "__len__") and not isinstance(value, str | bytes):
            names = list(getattr(message, "name", [])) or list(getattr(message, "joint_names", []))
            labels = [f"{here}[{names[k] if len(names) == len(value) else k}]" for k in range(len(value))]
            for label, one in zip(labels, value, strict=True):
                found += [label] if isinstance(one, int | float) else fields_of(one, label) if has_fields(one) else []
        elif not isinstance(value, str | bytes) and name != "header":
            found += fields_of(value, here)
    return found


def has_fields(value: Any) -> bool:
    """Whether a value is a message."""
    return hasattr(value, "__slots__") or hasattr(value, "__dict__")


def messages(data: bytes, source: str, topics: set[str] | None) -> Iterator[tuple[str, str, Any, int]]:
    """(topic, type, message, log time [ns]) of every message on some topics; on all for None.

    Of all topics the message is None where it cannot be decoded; InputError for one of those that are named.
    """
    try:
        if source.lower().endswith(SQLITE):
            yield from sqlite_messages(data, source, topics)
        else:
            yield from mcap_messages(data, source, topics)
    except InputError:
        raise
    except ImportError:
        raise InputError(f"{source}: ROS 2 bags need mcap-ros2-support; install exodrake[mcap]") from None
    except Exception as error:  # the parser raises whatever damaged bytes lead it to
        reason = (str(error) or type(error).__name__).splitlines()[0][:120]
        raise InputError(f"{source}: not a whole ROS 2 bag ({reason})") from None


def mcap_messages(data: bytes, source: str, topics: set[str] | None) -> Iterator[tuple[str, str, Any, int]]:
    """`messages` of MCAP storage, those of a topic by the numbers that they carry, else as they are stored.

    Not by their time: a recorder's clock may have stepped back.
    """
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    factory = DecoderFactory()
    reader = make_reader(io.BytesIO(data))
    stored = list(reader.iter_messages(topics=list(topics) if topics else None, log_time_order=False))
    numbers: dict[int, list[int]] = {}
    for _, channel, raw in stored:
        numbers.setdefault(channel.id, []).append(raw.sequence)
    counted = {channel for channel, found in numbers.items() if len(set(found)) == len(found)}
    stored.sort(key=lambda item: item[2].sequence if item[1].id in counted else 0)
    for schema, channel, raw in stored:
        decode = factory.decoder_for(channel.message_encoding, schema)
        if decode is None and topics:
            raise InputError(f"{source}: topic {channel.topic!r} is no ROS 2 message that can be decoded")
        yield channel.topic, schema.name if schema else "", decode(raw.data) if decode else None, raw.log_time


def sqlite_messages(data: bytes, source: str, topics: set[str] | None) -> Iterator[tuple[str, str, Any, int]]:
    """`messages` of SQLite storage."""
    from mcap_ros2._dynamic import generate_dynamic

    bag = sqlite3.connect(":memory:")
    bag.deserialize(data)
    kinds = {str(name).lower(): sql for name, sql in bag.execute("SELECT name, sql FROM sqlite_master")}
    for table in ("topics", "messages", "message_definitions"):  # a view, or a virtual table, may have no end
        if table in kinds and not str(kinds[table]).upper().startswith("CREATE TABLE"):
            raise InputError(f"{source}: {table!r} is no table, so this is no bag that ROS 2 wrote")
    listed = {n: (str(topic), str(kind)) for n, topic, kind in bag.execute("SELECT id, name, type FROM topics")}
    stored = "message_definitions" in kinds
    rows = bag.execute("SELECT topic_type, encoded_message_definition FROM message_definitions") if stored else ()
    texts = DEFINITIONS | {kind: text for kind, text in rows if text}
    decoders: dict[int, Any] = {}
    for number, (topic, kind) in listed.items():
        if (topics is None or topic in topics) and kind in texts:
            decoders[number] = generate_dynamic(kind, texts[kind])[kind]
        elif topics is not None and topic in topics:
            raise InputError(f"{source}: topic {topic!r}: the bag holds no definition of {kind}; convert it to MCAP")
    for number, time, raw in bag.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id"):
        if number in listed and (topics is None or number in decoders) and isinstance(time, int):
            yield *listed[number], decoders[number](raw) if number in decoders else None, time


def _field(message: Any, path: str, where: str) -> float | None:
    """`wrench.force.z`, `position[0]` or `position[MCP]` of a message, as a number; None if it lacks the element."""
    value = message
    for part in path.split("."):
        name, bracket, index = part.partition("[")
        if not hasattr(value, name):
            raise InputError(f"{where} has no field {path!r}")
        owner, value = value, getattr(value, name)
        if bracket:
            value = _element(owner, value, index.rstrip("]"), where, path)
    try:
        return None if value is None else float(value)
    except (TypeError, ValueError):
        raise InputError(f"{where}: field {path!r} is not a number") from None


def _element(owner: Any, values: Any, index: str, where: str, path: str) -> Any:
    """An element by its number, or by the message's own `name` list.

    None if this message lacks it, as do those of another publisher on the topic. InputError for a name that the list
    holds twice.
    """
    names = list(getattr(owner, "name", []))
    if names.count(index) > 1:
        raise InputError(f"{where}: field {path!r}: a message names {index!r} twice")
    position = names.index(index) if index in names else int(index) if index.isdecimal() and len(index) < 10 else None
    if position is None and not names:
        raise InputError(f"{where}: field {path!r}: no element {index!r}")
    return None if position is None or position >= len(values) else values[position]


def _stamp(message: Any, topic: str, source: str) -> float:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        raise InputError(f"{source}: topic {topic!r} has no header stamp; leave `stamp: header` out")
    return stamp.sec + stamp.nanosec * 1e-9
