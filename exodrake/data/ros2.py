"""Messages of topics: ROS 2 bags in MCAP or SQLite storage, MCAP with JSON or Protobuf. Needs the extra `mcap`.

A column is `TOPIC:FIELD`: `/joint_states:position[MCP]` (the element whose `name` is MCP), `/joint_states:effort[0]`,
`/wrench:wrench.force.z`, `/speed_command:data`; fields of JSON and Protobuf stand by the same rules, those of a
`tensorflow.Example` by their keys: `/timestep:observation/joints[0]`. Definitions of ROS messages
come from the bag; older SQLite bags hold none, and only the common types of ros2_messages.txt can be read from them.
"""

import io
import math
import re
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from exodrake.core.errors import InputError, require_extra
from exodrake.core.files import is_folder, read_bytes
from exodrake.core.schema import parse_json
from exodrake.data.formats import read_apart
from exodrake.data.formats.mcap import is_log

MCAP, SQLITE = ".mcap", ".db3"
STATE = "sensor_msgs/msg/JointState"
Topic = tuple[str, int, list[str] | None]  # type, number of messages, fields; None: they cannot be decoded


class Track(NamedTuple):
    """A foreign column with a clock of its own: time (n,) [s], values (n,) in the foreign unit."""

    time: np.ndarray
    values: np.ndarray


def is_bag(path: str | Path) -> bool:
    """Whether a path is a bag: a file of its storage, or a folder that holds such; a log of ours in MCAP is none."""
    return bool(bag_files(path))


def bag_files(path: str | Path) -> list[Path]:
    """Files of a bag, in order: `bag_10` after `bag_9`."""
    files = Path(path).iterdir() if is_folder(path) else [Path(path)]
    found = [file for file in files if file.name.lower().endswith((MCAP, SQLITE)) and not is_log(file)]
    split = {file: re.split(r"([0-9]{1,18})", file.name) for file in found}  # into texts and numbers
    return sorted(found, key=lambda f: [(int(part), "") if part.isdecimal() else (-1, part) for part in split[f]])


def read_bag(path: str | Path, columns: Sequence[str], stamp: str) -> dict[str, Track]:
    """Column -> samples with their times [s] of a bag; a bag of several files as one."""
    read = partial(read_tracks, columns=list(columns), stamp=stamp)
    parts, found = [read_apart(read, read_bytes(f), str(f)) for f in bag_files(path)], {}
    for column in columns:
        found[column] = Track(*map(np.concatenate, zip(*(part[column] for part in parts))))
        if not len(found[column].time):
            topic = column.partition(":")[0]
            raise InputError(f"{path}: no message on topic {topic!r} gives column {column!r}, which is empty")
    return found


def read_topics(path: str | Path) -> dict[str, Topic]:
    """Topic -> type, number of messages, and numeric fields of its first message, None if it cannot be decoded."""
    found: dict[str, Topic] = {}
    for file in bag_files(path):
        found = read_apart(partial(list_topics, found=found), read_bytes(file), str(file))
    return found


def read_tracks(data: bytes, source: str, columns: Sequence[str], stamp: str) -> dict[str, Track]:
    """Column -> samples with their times [s]: of the recorder (`log`), the publisher or the message's `header`."""
    wanted: dict[str, list[str]] = {}
    for column in columns:
        topic, _, field = column.partition(":")
        if not field:
            raise InputError(f"{source}: column {column!r}: wanted TOPIC:FIELD, like '/joint_states:position[MCP]'")
        wanted.setdefault(topic, []).append(field)
    samples: dict[str, list[tuple[float, float]]] = {column: [] for column in columns}
    for topic, _, message, nanoseconds in messages(data, source, set(wanted), stamp == "publish"):
        where, time = f"{source}: topic {topic!r}", nanoseconds * 1e-9
        if stamp == "header":
            own = _get(_get(message, "header"), "stamp") or _get(message, "timestamp")  # of ROS, of Foxglove's JSON
            try:
                time = float(_get(own, "sec", math.nan)) + 1e-9 * float(_get(own, "nanosec", _get(own, "nsec", 0)))
            except (TypeError, ValueError, OverflowError):
                time = math.nan
            if not math.isfinite(time):
                raise InputError(f"{where} has no header stamp; leave `stamp: header` out")
        for field in wanted[topic]:
            if (value := _field(message, field, where)) is not None:
                samples[f"{topic}:{field}"].append((time, value))
    return {column: Track(*np.array(rows).reshape(-1, 2).T.copy()) for column, rows in samples.items()}


def list_topics(data: bytes, source: str, found: dict[str, Topic]) -> dict[str, Topic]:
    """`read_topics` of one file, with what was found in those before."""
    for topic, kind, message, _ in messages(data, source, None):
        _, count, fields = found.get(topic, (kind, 0, None))
        found[topic] = kind, count + 1, numeric_fields(message) if fields is None and message is not None else fields
    return found


def _get(message: Any, name: str, default: Any = None) -> Any:
    """A field of a message, which is an object of ROS or a mapping of JSON."""
    return message.get(name, default) if isinstance(message, dict) else getattr(message, name, default)


def _labels(owner: Any, values: Any) -> list[str]:
    """What a message calls the elements of one of its lists: by their own `name`, or by a list of names beside it."""
    named = isinstance(values, list) and _get(next(iter(values), 0), "name")
    own = [_get(one, "name") for one in values] if named else []
    if own and all(isinstance(name, str) for name in own):
        return own
    beside = (_get(owner, key) for key in ("name", "joint_names", "names"))
    return [str(name) for name in next((one for one in beside if isinstance(one, list | tuple) and one), ())]


def numeric_fields(message: Any, path: str = "") -> list[str]:
    """Numeric fields of a message, elements of lists by their labels where they have such."""
    if isinstance(message, bool | int | float):
        return [path]
    if isinstance(message, str | bytes) or message is None:
        return []
    if hasattr(message, "__len__") and not isinstance(message, dict):
        return [field for k, one in enumerate(message) for field in numeric_fields(one, f"{path}[{k}]")]
    found: list[str] = []
    for name in message if isinstance(message, dict) else getattr(message, "__slots__", None) or vars(message):
        value, here = _get(message, name), f"{path}.{name}" if path else name
        labels = _labels(message, value)
        if isinstance(value, list | tuple) and labels and len(value) == len(labels):
            found += [field for label, one in zip(labels, value) for field in numeric_fields(one, f"{here}[{label}]")]
        elif name != "header":
            found += numeric_fields(value, here)
    return found


def messages(
    data: bytes, source: str, topics: set[str] | None, published: bool = False
) -> Iterator[tuple[str, str, Any, int]]:
    """(topic, type, message, time [ns]) on some topics; on all for None, where undecodable messages are None."""
    with require_extra(f"{source}: bags need the packages of the extra mcap; install exodrake[mcap]"):
        if source.lower().endswith(SQLITE):
            yield from sqlite_messages(data, source, topics)
        else:
            yield from mcap_messages(data, source, topics, published)


def mcap_messages(
    data: bytes, source: str, topics: set[str] | None, published: bool
) -> Iterator[tuple[str, str, Any, int]]:
    """`messages` of MCAP storage by their numbers, else as stored: a recorder's clock may have stepped back."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    ros, protobuf = DecoderFactory(), None
    reader = make_reader(io.BytesIO(data))
    stored = list(reader.iter_messages(topics=list(topics) if topics else None, log_time_order=False))
    numbers: dict[int, list[int]] = {}
    for _, channel, raw in stored:
        numbers.setdefault(channel.id, []).append(raw.sequence)
    counted = {channel for channel, found in numbers.items() if len(set(found)) == len(found)}
    stored.sort(key=lambda item: item[2].sequence if item[1].id in counted else 0)
    for schema, channel, raw in stored:
        where = f"{source}: topic {channel.topic!r}"
        if channel.message_encoding == "json":
            message = parse_json(raw.data, where)
        elif decode := ros.decoder_for(channel.message_encoding, schema):
            message = decode(raw.data)
        elif schema and schema.encoding == channel.message_encoding == "protobuf":
            protobuf = protobuf or import_module("mcap_protobuf.decoder").DecoderFactory()
            message = plain_message(protobuf.decoder_for("protobuf", schema)(raw.data))
        elif topics:
            words = "is read neither as a ROS 2 message nor as JSON or Protobuf"
            raise InputError(f"{where}: {channel.message_encoding!r} {words}")
        else:
            message = None
        time = raw.publish_time if published else raw.log_time
        yield channel.topic, schema.name if schema else channel.message_encoding, message, time


def plain_message(message: Any) -> Any:
    """A Protobuf message without its bytes as JSON would have it; numbers of a `tensorflow.Example` by their keys."""
    if isinstance(message, Mapping):
        return {str(key): plain_message(value) for key, value in message.items()}
    if isinstance(message, Sequence) and not isinstance(message, str | bytes):
        return [plain_message(one) for one in message]
    if isinstance(message, bool | int | float | str | bytes):
        return message
    kind = message.DESCRIPTOR
    if kind.full_name == "tensorflow.Example":
        lists = ((key, one.float_list.value or one.int64_list.value) for key, one in message.features.feature.items())
        return {key: list(values) for key, values in lists if values}
    fields = [f.name for f in kind.fields if not f.message_type or f.is_repeated or message.HasField(f.name)]
    return {name: plain_message(getattr(message, name)) for name in fields}


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
    common = Path(__file__).with_name("ros2_messages.txt").read_text().split("\n\n")  # a type, then its definition
    texts = dict(text.split("\n", 1) for text in common) | {kind: text for kind, text in rows if text}
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
    whole = isinstance(message, dict) and path in message  # keys of JSON may hold dots
    value: Any = message[path] if whole else message
    steps = re.findall(r"[^.\[]+(?:\[[^\]]*\]?)*|\[[^\]]*\]?", path)  # `a.b[0][MCP]`: names, indices behind them
    for name, *indices in () if whole else (step.replace("]", "").split("[") for step in steps):
        if name and _get(value, name, _get) is _get:
            raise InputError(f"{where} has no field {path!r}")
        owner, value = value, _get(value, name) if name else value
        for index in indices:  # a number or label; a message of another publisher on the topic may lack the element
            names = _labels(owner, value)
            if names.count(index) > 1:
                raise InputError(f"{where}: field {path!r}: a message names {index!r} twice")
            number = int(index) if index.isdecimal() and len(index) < 10 else None
            position = names.index(index) if index in names else number
            if position is None and not names:
                raise InputError(f"{where}: field {path!r}: no element {index!r}")
            value = None if position is None or value is None or position >= len(value) else value[position]
    try:
        return None if value is None else float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: field {path!r} is not a number") from None
