"""ROS 2 bags in MCAP storage: any numeric field of a message whose definition the bag carries. Needs the extra `mcap`.

A column is `TOPIC:FIELD`: `/joint_states:position[MCP]` (the element whose `name` is MCP), `/joint_states:effort[0]`,
`/wrench:wrench.force.z`, `/speed_command:data`.
"""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.foreign.track import Track


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
    for topic, message, log_time in _messages(data, source, list(wanted)):
        time = _stamp(message, topic, source) if stamp == "header" else log_time * 1e-9
        for field in wanted[topic]:
            times, values = samples[f"{topic}:{field}"]
            times.append(time)
            values.append(_field(message, field, f"{source}: topic {topic!r}"))
    for column, (times, _) in samples.items():
        if not times:
            raise InputError(f"{source}: no message on topic {column.partition(':')[0]!r}")
    return {column: Track(np.array(times), np.array(values)) for column, (times, values) in samples.items()}


def _messages(data: bytes, source: str, topics: list[str]) -> list[tuple[str, Any, int]]:
    """(topic, message, log time ns) of every message on the topics."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise InputError(f"{source}: ROS 2 bags need mcap-ros2-support; install exodrake[mcap]") from None
    try:
        reader = make_reader(io.BytesIO(data), decoder_factories=[DecoderFactory()])
        found = reader.iter_decoded_messages(topics=topics)
        return [(channel.topic, message, raw.log_time) for _, channel, raw, message in found]
    except Exception as error:  # the parser raises whatever damaged bytes lead it to
        reason = (str(error) or type(error).__name__).splitlines()[0][:120]
        raise InputError(f"{source}: not a whole ROS 2 bag in MCAP ({reason})") from None


def _field(message: Any, path: str, where: str) -> float:
    """`wrench.force.z`, `position[0]` or `position[MCP]` of a message, as a number."""
    value = message
    for part in path.split("."):
        name, bracket, index = part.partition("[")
        if not hasattr(value, name):
            raise InputError(f"{where} has no field {path!r}")
        owner, value = value, getattr(value, name)
        if bracket:
            value = _element(owner, value, index.rstrip("]"), where, path)
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f"{where}: field {path!r} is not a number") from None


def _element(owner: Any, values: Any, index: str, where: str, path: str) -> Any:
    """An element by its number, or by the message's own `name` list; NaN if this message lacks it."""
    names = list(getattr(owner, "name", []))
    position = names.index(index) if index in names else int(index) if index.isdecimal() and len(index) < 10 else None
    if position is None and not names:
        raise InputError(f"{where}: field {path!r}: no element {index!r}")
    return np.nan if position is None or position >= len(values) else values[position]


def _stamp(message: Any, topic: str, source: str) -> float:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        raise InputError(f"{source}: topic {topic!r} has no header stamp; leave `stamp: header` out")
    return stamp.sec + stamp.nanosec * 1e-9
