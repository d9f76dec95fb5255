"""Recordings in JSON, and in JSON lines, one record a line."""

from typing import Any

from exodrake.core.child import in_child
from exodrake.core.errors import InputError
from exodrake.core.json_file import parse_json
from exodrake.data.log import check_size


def read_records(data: bytes, source: str) -> Any:
    """The content of a JSON file. InputError for a damaged or too large one."""
    check_size(data.count(b","), source)
    return in_child(parse, data, source, source=source, size=len(data))


def parse(data: bytes, source: str) -> Any:
    """`read_records` in this process."""
    if not source.lower().endswith(".json"):
        lines = enumerate(data.removeprefix(b"\xef\xbb\xbf").splitlines(), 1)
        return [parse_json(line, f"{source}, record {number}") for number, line in lines if line.strip()]
    found = parse_json(data, source)
    if not isinstance(found, dict | list):
        raise InputError(f"{source}: holds one value, wanted objects or lists")
    return found
