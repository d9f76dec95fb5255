"""JSON files as plain data."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes

MAX_BYTES = 200_000_000  # a thousand times the longest answer


def read_json(path: str | Path) -> Any:
    """The content of a JSON file. InputError naming the file, and the line of what is not JSON."""
    data = read_bytes(path)
    if len(data) > MAX_BYTES:
        raise InputError(f"{path}: {len(data)} bytes, more than {MAX_BYTES}")
    try:
        return json.loads(data)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}, line {error.lineno}: not JSON ({error.msg})") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON ({type(error).__name__})") from None
