"""Results as plain data, and their files: JSON, or NPZ with every array in full; neither holds a pickle."""

import io
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import write_bytes

REST = "json"  # entry of an NPZ file that holds all that is no array


def plain(value: Any) -> Any:
    """A result as data that JSON can hold.

    Dataclasses become mappings, arrays lists, complex numbers [real, imaginary], and what is not finite null;
    functions are left out. A class with a method `to_json` says itself what it is.
    """
    return _plain(value, lambda array, _: array.tolist() if np.isfinite(array).all() else list(map(plain, array)), "")


def to_dict(result: Any) -> dict[str, Any]:
    """A result as a mapping of plain data, as in its JSON file.

    Examples:
        >>> import exodrake as exo
        >>> to_dict(exo.Requirements())
        {'settling': None, 'overshoot': 0.05, 'disk_margin': 0.6, 'noise': None}
    """
    found = plain(result)
    return found if isinstance(found, dict) else {"value": found}


def save(result: Any, path: str | PurePath) -> None:
    """Write a result, whole or not at all.

    Args:
        result: any result of this package, or mappings and lists of them.
        path: `.json` (what is not finite as null), or `.npz` (arrays to the last bit by dotted name, for `np.load`
            without pickles; the rest as JSON text in the entry `json`).

    Raises:
        InputError: for another ending, and where the file cannot be written.

    Examples:
        >>> save({"gain": 2.0}, "gain.json")
    """
    ending = PurePath(path).suffix.lower()
    if ending == ".json":
        write_bytes(path, (json.dumps(to_dict(result), indent=1, allow_nan=False) + "\n").encode())  # pyright: ignore
        return
    if ending != ".npz":
        raise InputError(f"{path}: results are saved as .json or .npz")
    arrays: dict[str, np.ndarray] = {}
    rest = _plain(result, lambda array, name: arrays.setdefault(name, array) is None, "")
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays, **{REST: np.array(json.dumps(rest, allow_nan=False))})
    write_bytes(path, stream.getvalue())  # pyright: ignore


def _plain(value: Any, array: Any, name: str) -> Any:
    """Plain data of a value; array: makes plain data of a numeric array (n, ...) and its dotted name."""
    parts = value
    if own := getattr(value, "to_json", getattr(value, "_asdict", None)):
        parts = own()
    elif is_dataclass(value) and not isinstance(value, type):
        parts = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(parts, Mapping):
        kept = {str(k): v for k, v in parts.items() if not callable(v)}
        return {k: _plain(v, array, f"{name}.{k}" if name else k) for k, v in kept.items()}
    if isinstance(parts, np.ndarray) and parts.dtype.kind in "biuf" and parts.ndim:
        return array(parts, name or "value")
    if isinstance(parts, Iterable) and not isinstance(parts, str | bytes) and getattr(parts, "shape", True):
        return [_plain(v, array, f"{name}.{i}" if name else str(i)) for i, v in enumerate(parts)]
    value = parts.item() if isinstance(parts, np.generic | np.ndarray) else parts
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Enum):
        return value.name
    return value if value is None or isinstance(value, bool | int | str) else str(value)
