"""MCAP, for Foxglove and PlotJuggler: a topic per kind (`/tension` with fields AF, MF, AE), JSON messages with schema.

A row of the log is one message on every topic, which carry its number. The exact times are on `/time`, since
MCAP's own are whole nanoseconds. A metadata record says which field is which column. Needs the extra `mcap`.
"""

import io
import json
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError, require_extra
from exodrake.core.files import is_file
from exodrake.core.schema import parse_json
from exodrake.data.formats import read_apart
from exodrake.data.log import Log, log_from_columns, refuse_doubled
from exodrake.model.units import find_kind

ENDINGS = (".mcap",)
RECORD = "exodrake.data.log"
LIBRARY = "exodrake"  # in the header of the file
PROFILE_AT = 17  # byte after magic (8), opcode (1) and length (8) of the header, where profile and library begin
LATEST = 2.0**64  # ns, MCAP's stamps
MISSING = "MCAP needs the mcap package; install exodrake[mcap]"
BARE = "value"  # field of a column that has no channel in its name


def is_log(path: str | Path) -> bool:
    """Whether an MCAP file is one that `write` made, by the library in its header."""
    written = struct.pack("<II", 0, len(LIBRARY)) + LIBRARY.encode()  # lengths of profile and library, each a text
    if not is_file(path):
        return False
    try:
        with open(path, "rb") as stream:
            return stream.read(PROFILE_AT + len(written))[PROFILE_AT:] == written
    except OSError:
        return False


def read(data: bytes, source: str) -> Log:
    """Parse an MCAP file that `write` made. InputError for a damaged or foreign file, and for mcap not installed."""
    return log_from_columns(read_apart(parse, data, source).items(), source)


def parse(data: bytes, source: str) -> dict[str, np.ndarray]:
    """Columns by their headings."""
    with require_extra(f"{source}: {MISSING}"):
        from mcap.reader import make_reader
    reader = make_reader(io.BytesIO(data))
    records = {record.name: record.metadata for record in reader.iter_metadata()}
    if RECORD not in records:
        raise InputError(f"{source}: MCAP of another program; use `exodrake import` with a mapping file")
    topics: dict[str, dict[tuple[int, int], Mapping[str, float]]] = {}  # by number and time [ns] of a message
    for _, channel, message in reader.iter_messages(log_time_order=False):
        found, place = topics.setdefault(channel.topic, {}), (message.sequence, message.log_time)
        if place in found:
            raise InputError(f"{source}: topic {channel.topic!r}: message {message.sequence} comes twice")
        found[place] = parse_json(message.data, f"{source}: topic {channel.topic!r}")
    places = [(str(n), str(u), str(t), str(f)) for n, u, t, f in json.loads(records[RECORD]["columns"])]
    rows = sorted(set().union(*topics.values()))  # by their numbers, then their time: a file may hold them in any order
    for topic in sorted({topic for _, _, topic, _ in places}):
        if lost := [row for row in rows if row not in topics.get(topic, ())]:
            count = f"{len(lost)} messages are" if len(lost) > 1 else "a message is"
            first = f"the first is message {lost[0][0]} at {lost[0][1] * 1e-9:g} s"
            raise InputError(f"{source}: topic {topic!r}: {count} missing that other topics have, {first}")
    refuse_doubled((f"{name} [{unit}]" for name, unit, *_ in places), source)
    return {f"{n} [{u}]": np.array([float(topics[t][row].get(f, np.nan)) for row in rows]) for n, u, t, f in places}


def write(log: Log) -> bytes:
    """The log as MCAP in SI. A missing sample is a field left out."""
    with require_extra(f"{log.label}: {MISSING}"):
        from mcap.writer import Writer
    start = min(0.0, float(log.time.min()))  # MCAP has no time before 0
    if (float(log.time.max()) - start) * 1e9 >= LATEST:
        raise InputError(f"{log.label}: column 'time': {log.time.max():g} s is beyond what MCAP can stamp")
    units, columns = {"time": "s"} | log.units, {"time": log.time.tolist()}
    topics: dict[str, dict[str, str]] = {"/time": {BARE: "time"}}  # topic -> field -> column
    places = {"time": ("/time", BARE)}
    for name, values in log.signals.items():
        kind = find_kind(name)
        topic, field = (f"/{kind}", name[len(kind) + 1 :] or BARE) if kind else (f"/{name}", BARE)
        if field in topics.get(topic, {}):
            topic, field = f"/{name}", BARE
        topics.setdefault(topic, {})[field] = name
        places[name], columns[name] = (topic, field), values.tolist()
    stream, channels = io.BytesIO(), {}
    writer = Writer(stream)
    writer.start(library=LIBRARY)
    for topic, fields in topics.items():
        properties = {field: {"type": "number", "description": units[name]} for field, name in fields.items()}
        content = json.dumps({"type": "object", "title": topic[1:], "properties": properties}).encode()
        schema = writer.register_schema(name=f"exodrake{topic}", encoding="jsonschema", data=content)
        channels[topic] = writer.register_channel(topic=topic, message_encoding="json", schema_id=schema)
    for row, time in enumerate(columns["time"]):
        stamp = round((time - start) * 1e9)
        for topic, fields in topics.items():
            message = {field: columns[name][row] for field, name in fields.items()}
            text = json.dumps({field: value for field, value in message.items() if value == value})
            writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, data=text.encode(), sequence=row)
    writer.add_metadata(RECORD, {"columns": json.dumps([[name, units[name], *places[name]] for name in columns])})
    writer.finish()
    return stream.getvalue()
