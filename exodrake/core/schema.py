"""Plain data in YAML and JSON files, and schemas: functions of a value and its place that return it or refuse it.

    SCHEMA = mapping({"name": text(), "period": number(above=0.0), "logs": listing(LOG, least=1)}, required=("logs",))

Scalars are those of YAML 1.2: `1e-3` is a number; `1:30`, `no` and dates are text.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, Concatenate

from exodrake.core.errors import InputError, nearest
from exodrake.core.files import read_bytes

MAX_JSON = 200_000_000  # bytes, a thousand times the longest answer
MAX_BYTES = 4_000_000  # of YAML, a hundred times the longest robot file
MAX_DEPTH = 20  # nested mappings and lists; a scenario with a robot in it has 7
BREAKS = "\x85\u2028\u2029\ufeff"  # line breaks and marks of Unicode that must be escaped
MAX_DIGITS = 4000  # Python converts no longer integers
CONSTANTS: dict[str, Any] = dict.fromkeys(("", "~", "null", "Null", "NULL"))
CONSTANTS |= dict.fromkeys(("true", "True", "TRUE"), True) | dict.fromkeys(("false", "False", "FALSE"), False)
INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
SPECIAL = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
MAX_PLACE, MAX_SHOWN = 160, 40  # characters
MAX_WHOLE = 1_000_000_000  # of rows, frames and other counts


def read_json(path: str | Path) -> Any:
    """The content of a JSON file. InputError naming the file, and the line of what is not JSON or a doubled key."""
    return parse_json(read_bytes(path), str(path))


def parse_json(data: bytes | str, source: str) -> Any:
    """The content of JSON text. InputError as `read_json`."""
    if len(data) > MAX_JSON:
        raise InputError(f"{source}: {len(data)} bytes, more than {MAX_JSON}")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        """An object by its keys and values; of a key that comes twice, Python would keep the last."""
        if len(found := dict(pairs)) < len(pairs):
            keys = [key for key, _ in pairs]
            raise InputError(f"key {quote(next(key for key in keys if keys.count(key) > 1))} comes twice")
        return found

    try:
        return json.loads(data, object_pairs_hook=unique)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    except json.JSONDecodeError as error:
        raise InputError(f"{source}, line {error.lineno}: not JSON ({error.msg})") from None
    except RecursionError:
        raise InputError(f"{source}: nested too deep") from None
    except ValueError as error:
        raise InputError(f"{source}: not JSON ({str(error)[:80]})") from None


def read_yaml(path: str | Path) -> Any:
    """`parse_yaml` of a file."""
    return parse_yaml(read_bytes(path), path)


def parse_yaml(data: bytes, source: str | Path) -> Any:
    """Mappings with text keys, lists and scalars of YAML text. InputError names the line of what is no plain data."""
    import yaml

    if len(data) > MAX_BYTES:
        raise refusal(str(source), f"{len(data)} bytes, more than {MAX_BYTES}")
    try:
        events = yaml.parse(data, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        next(events)
        if isinstance(next(events), yaml.StreamEndEvent):
            return None
        content = _node(next(events), events, str(source), 0)
        next(events)
        extra: Any = next(events)
        if not isinstance(extra, yaml.StreamEndEvent):
            raise refusal(f"{source}, line {extra.start_mark.line + 1}", "not YAML (a second document)")
        return content
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {min(mark.line, data.count(10)) + 1}" if mark else ""
        raise refusal(f"{source}{line}", f"not YAML ({getattr(error, 'problem', None) or 'unreadable'})") from None
    except (ValueError, TypeError, OverflowError, AttributeError) as error:
        raise refusal(str(source), f"not YAML ({type(error).__name__})") from None


def dump_yaml(content: Any) -> str:
    """YAML text that `parse_yaml` reads back as the same values; keys keep their order."""
    import yaml

    class Dumper(yaml.SafeDumper):
        """Quotes text that YAML 1.2 would read as a number."""

    for kind, pattern in (("int", INTEGER), ("float", FLOAT)):
        Dumper.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", re.compile(f"^(?:{pattern.pattern})$"), None)
    written = yaml.dump(content, Dumper=Dumper, sort_keys=False, allow_unicode=True)
    return yaml.dump(content, Dumper=Dumper, sort_keys=False) if any(c in written for c in BREAKS) else written


def _node(event: Any, events: Iterator[Any], source: str, depth: int) -> Any:
    """The value that begins with an event; the events up to its end are used up."""
    import yaml

    where = f"{source}, line {event.start_mark.line + 1}"
    if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
        raise refusal(where, "not YAML of this kind: anchors and aliases are refused")
    if event.tag is not None:
        raise refusal(where, f"not YAML of this kind: the tag {quote(event.tag)} is refused")
    if depth > MAX_DEPTH:
        raise refusal(where, f"not YAML of this kind: nested more than {MAX_DEPTH} deep")
    if isinstance(event, yaml.ScalarEvent):
        return _scalar(event.value) if event.style in (None, "") else event.value
    if isinstance(event, yaml.SequenceStartEvent):
        within = takewhile(lambda one: not isinstance(one, yaml.SequenceEndEvent), events)
        return [_node(one, events, source, depth + 1) for one in within]
    content: dict[str, Any] = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        where = f"{source}, line {event.start_mark.line + 1}"
        if not isinstance(event, yaml.ScalarEvent):
            raise refusal(where, "not YAML of this kind: a key is no name")
        _node(event, events, source, depth)
        if event.value in content:
            raise refusal(where, f"key {quote(event.value)} comes twice")
        content[event.value] = _node(next(events), events, source, depth + 1)
    return content


def _scalar(text: str) -> Any:
    """A plain scalar by the core schema of YAML 1.2; a number too large for its type stays text."""
    if text in CONSTANTS:
        return CONSTANTS[text]
    if INTEGER.fullmatch(text) and len(text) < MAX_DIGITS:
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
    if FLOAT.fullmatch(text) and math.isfinite(float(text)):
        return float(text)
    return float(text.replace(".", "")) if SPECIAL.fullmatch(text) else text


Schema = Callable[[Any, str], Any]


def quote(value: Any) -> str:
    """A value for a message, shortened, control characters escaped."""
    written = repr(value)
    return "nothing" if value is None else written if len(written) <= MAX_SHOWN else written[: MAX_SHOWN - 3] + "..."


def refusal(where: str, reason: str) -> InputError:
    """An InputError of one sentence: `where: reason`, of a long place only its end."""
    return InputError(f"{where if len(where) <= MAX_PLACE else '...' + where[-MAX_PLACE:]}: {reason}")


def inside(where: str, key: str) -> str:
    """The place of a key: `file, 'outer.inner'`."""
    name = key if len(key) <= MAX_SHOWN else key[: MAX_SHOWN - 3] + "..."
    return f"{where[:-1]}.{name}'" if where.endswith("'") else f"{where}, '{name}'"


def anything(value: Any, where: str) -> Any:
    """Any value."""
    return value


def flag(value: Any, where: str) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise refusal(where, f"wanted true or false, found {quote(value)}")
    return value


def schema_maker[**P](check: Callable[Concatenate[Any, str, P], Any]) -> Callable[P, Schema]:
    """The function that makes schemas of a check, from what the check takes beyond a value and its place."""
    return lambda *args, **options: lambda value, where: check(value, where, *args, **options)


@schema_maker
def text(value: Any, where: str, choices: Sequence[str] = (), length: int | None = None) -> str:
    """Text: one of the choices if there are any, of that length if one is given."""
    if not isinstance(value, str) or (length is not None and len(value) != length):
        wanted = "text" if length is None else f"text of {length} character{'s' * (length > 1)}"
        raise refusal(where, f"wanted {wanted}, found {quote(value)}")
    if choices and value not in choices:
        raise refusal(where, f"{quote(value)} is none of {', '.join(choices)}")
    return value


@schema_maker
def number(
    value: Any, where: str, above: float = -math.inf, low: float = -math.inf, high: float = math.inf, unit: str = ""
) -> float:
    """A number in (above, inf) and [low, high], not NaN; infinite only if the range has no end there."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise refusal(where, f"wanted a number{unit and f' [{unit}]'}, found {quote(value)}")
    try:
        found = float(value)
    except OverflowError:
        raise refusal(where, f"{quote(value)} is too large a number") from None
    if math.isnan(found):
        raise refusal(where, "is not a number (NaN)")
    if not (found > above or above == -math.inf) or not low <= found <= high:
        limits = [f"above {above:g}"] * (above > -math.inf) + [f"from {low:g}"] * (low > -math.inf)
        limits += [f"up to {high:g}"] * (high < math.inf)
        raise refusal(where, f"wanted a number {' '.join(limits)}{unit and f' {unit}'}, found {quote(value)}")
    return found


@schema_maker
def whole(value: Any, where: str, low: int = 0) -> int:
    """A whole number from `low` to MAX_WHOLE."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= MAX_WHOLE:
        raise refusal(where, f"wanted a whole number from {low} to {MAX_WHOLE}, found {quote(value)}")
    return value


@schema_maker
def optional(value: Any, where: str, schema: Schema) -> Any:
    """What the schema takes, or null."""
    return None if value is None else schema(value, where)


@schema_maker
def listing(
    value: Any, where: str, item: Schema, least: int = 0, length: int | None = None, wanted: str = "a list"
) -> list:
    """A list with at least so many items, or exactly so many; messages count items from 1."""
    if not isinstance(value, list) or len(value) < least or (length is not None and len(value) != length):
        raise refusal(where, f"wanted {wanted}, found {quote(value)}")
    return [item(one, f"{where} item {n + 1}") for n, one in enumerate(value)]


@schema_maker
def names(value: Any, where: str, item: Schema, least: int = 0) -> dict[str, Any]:
    """A mapping from free names to what `item` takes."""
    if not isinstance(value, Mapping) or len(value) < least:
        raise refusal(where, f"wanted names and values, found {quote(value)}")
    return {str(key): item(one, inside(where, str(key))) for key, one in value.items()}


@schema_maker
def mapping(value: Any, where: str, known: Mapping[str, Schema], required: Sequence[str] = ()) -> dict[str, Any]:
    """A mapping with known keys."""
    if not isinstance(value, Mapping):
        raise refusal(where, f"wanted keys and values ({', '.join(known)}), found {quote(value)}")
    for key in value:
        if key not in known:
            hint = nearest(str(key), list(known)) or f"; known keys: {', '.join(known)}"
            raise refusal(where, f"unknown key {quote(str(key))}{hint}")
    for key in required:
        if value.get(key) is None:
            raise refusal(where, f"key {key!r} is missing")
    return {key: known[key](one, inside(where, key)) for key, one in value.items()}


@schema_maker
def having(value: Any, where: str, known: Mapping[str, Schema], required: Sequence[str] = ()) -> dict[str, Any]:
    """A mapping whose known keys are checked; others pass as they are."""
    found = value if isinstance(value, Mapping) else {}
    kept = mapping(known, required)({k: v for k, v in found.items() if k in known} if found else value, where)
    return {**found, **kept}


@schema_maker
def either(value: Any, where: str, mappings: Schema, others: Schema, key: str | None = None) -> Any:
    """What the first schema takes of a mapping, one that has `key` if that is given, or the second of anything else."""
    return (mappings if isinstance(value, Mapping) and (key is None or key in value) else others)(value, where)
