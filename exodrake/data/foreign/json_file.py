"""JSON, and JSON lines, one record a line."""

import json
from typing import Any

from exodrake.core.child import in_child
from exodrake.core.errors import InputError
from exodrake.data.columns import check_size


def read_json(data: bytes, source: str) -> Any:
    """The content of a JSON file. InputError for a damaged or too large one."""
    check_size(data.count(b","), source)
    return in_child(parse, data, source, source=source, size=len(data))


def parse(data: bytes, source: str) -> Any:
    """`read_json` in this process."""
    try:
        text = data.decode("utf-8-sig")
        if not source.lower().endswith(".json"):
            return [json.loads(line) for line in text.splitlines() if line.strip()]
        found = json.loads(text)
    except RecursionError:
        raise InputError(f"{source}: nested too deep") from None
    except ValueError as error:
        raise InputError(f"{source}: not JSON ({str(error)[:80]})") from None
    if not isinstance(found, dict | list):
        raise InputError(f"{source}: holds one value, wanted objects or lists")
    return found
