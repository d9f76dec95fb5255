"""The form of a robot file: which keys there are, and what kind of value each takes. Names are checked where used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from exodrake.core.errors import InputError, nearest

Check = Callable[[Any, str], None]
STATED = ("unit", "range", "source")  # beside `value`


def check_content(content: Any, source: str) -> Mapping[str, Any]:
    """The content itself. InputError naming file and key for an unknown key, and for a value of the wrong kind."""
    for key, value in _mapping(content, source).items():
        if key not in KEYS:
            raise InputError(f"{source}: unknown key {key!r}{nearest(key, sorted(KEYS))}")
        if value is not None:
            KEYS[key](value, f"{source}: {key}")
    return content


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: wanted a mapping of keys, found {shown(value)}")
    for key in value:
        if not isinstance(key, str):
            raise InputError(f"{where}: key {shown(key)} is not a name")
    return value


def _text(value: Any, where: str) -> None:
    if not isinstance(value, str):
        raise InputError(f"{where}: wanted text, found {shown(value)}")


def _parts(value: Any, where: str) -> None:
    if not isinstance(value, list):
        raise InputError(f"{where}: wanted a list of names, found {shown(value)}")
    for item in value:
        _text(item, where)


def _numbers(value: Any, where: str) -> None:
    """Nested names down to numbers; a mapping with `value` may state unit, range and source."""
    for name, item in _mapping(value, where).items():
        if isinstance(item, Mapping) and "value" in item:
            _stated(item, f"{where}.{name}")
        elif isinstance(item, Mapping):
            _numbers(item, f"{where}.{name}")


def _stated(item: Mapping[str, Any], where: str) -> None:
    for key in _mapping(item, where):
        if key != "value" and key not in STATED:
            raise InputError(f"{where}: unknown key {key!r}{nearest(key, ['value', *STATED])}")
    if "unit" in item:
        _text(item["unit"], f"{where}.unit")
    span = item.get("range", [0, 0])
    if not (isinstance(span, list) and len(span) == 2 and all(_is_number(end) for end in span)):
        raise InputError(f"{where}.range: wanted [low, high], found {shown(span)}")


def _groups(value: Any, where: str) -> None:
    """Name -> name -> number or numbers per channel, as `effects`."""
    for name, item in _mapping(value, where).items():
        for inner, one in _mapping(item, f"{where}.{name}").items():
            if isinstance(one, Mapping):
                _channels(one, f"{where}.{name}.{inner}")


def _limits(value: Any, where: str) -> None:
    for name, item in _mapping(value, where).items():
        inner = _mapping(item, f"{where}.{name}")
        _channels(inner.get("value", inner), f"{where}.{name}")


def _grasps(value: Any, where: str) -> None:
    for name, item in _mapping(value, where).items():
        _channels(item, f"{where}.{name}")


def _channels(value: Any, where: str) -> None:
    """Wire or joint -> number."""
    for channel, one in _mapping(value, where).items():
        if not _is_number(one):
            raise InputError(f"{where}.{channel}: wanted a number, found {shown(one)}")


def _is_number(value: Any) -> bool:
    """A number, or text that is one: YAML 1.1 reads 1e-3 as text."""
    try:
        return not isinstance(value, bool) and value is not None and bool(float(value) == float(value))
    except (TypeError, ValueError, OverflowError):
        return False


def shown(value: Any) -> str:
    """A value, shortened, for a message."""
    text = repr(value)
    return "nothing" if value is None else text if len(text) <= 40 else text[:37] + "..."


def _tolerances(value: Any, where: str) -> None:
    """A list of {parameters, transform, prior_std, max_deviation}."""
    if not isinstance(value, list):
        raise InputError(f"{where}: wanted a list, found {shown(value)}")
    for number, item in enumerate(value):
        at = f"{where}, item {number + 1}"
        for key in ("parameters", "transform", "prior_std", "max_deviation"):
            if key not in _mapping(item, at):
                raise InputError(f"{at}: key {key!r} is missing")
        _parts(item["parameters"], f"{at}: parameters")
        if item["transform"] not in TRANSFORMS:
            raise InputError(f"{at}: transform {item['transform']!r} is none of {', '.join(TRANSFORMS)}")
        for key in ("prior_std", "max_deviation"):
            if not _is_number(item[key]) or float(item[key]) <= 0:
                raise InputError(f"{at}: {key}: wanted a number above 0, found {shown(item[key])}")


TRANSFORMS = ("relative", "additive", "log")

KEYS: Mapping[str, Check] = {
    "machine": _text, "base": _text, "parameters": _numbers, "effects": _groups, "parts": _parts, "limits": _limits,
    "grasps": _grasps, "tolerances": _tolerances, "notes": lambda value, where: None,
}  # fmt: skip
