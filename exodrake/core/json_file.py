"""JSON files as plain data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.core.schema import shown

MAX_BYTES = 200_000_000  # a thousand times the longest answer


def read_json(path: str | Path) -> Any:
    """The content of a JSON file. InputError naming the file, and the line of what is not JSON or a doubled key."""
    return parse_json(read_bytes(path), str(path))


def parse_json(data: bytes | str, source: str) -> Any:
    """The content of JSON text. InputError as `read_json`."""
    if len(data) > MAX_BYTES:
        raise InputError(f"{source}: {len(data)} bytes, more than {MAX_BYTES}")
    try:
        return json.loads(data, object_pairs_hook=_object)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except json.JSONDecodeError as error:
        raise InputError(f"{source}, line {error.lineno}: not JSON ({error.msg})") from None
    except RecursionError:
        raise InputError(f"{source}: nested too deep") from None
    except ValueError as error:
        raise InputError(f"{source}: not JSON ({str(error)[:80]})") from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object by its keys and values. InputError for a key that comes twice, of which Python would keep the last."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        raise InputError(f"key {shown(next(key for key in keys if keys.count(key) > 1))} comes twice")
    return found
