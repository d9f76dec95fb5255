"""YAML files as plain data: one loader with limits for robot files, scenarios, cases, mappings and layouts.

Scalars are those of YAML 1.2: `1e-3` is a number; `1:30`, `no` and dates are text. Anchors, aliases, tags
and keys that come twice are refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from exodrake.core.files import read_bytes
from exodrake.core.schema import refusal, shown

MAX_BYTES = 4_000_000  # a hundred times the longest robot file
MAX_DEPTH = 20  # nested mappings and lists; a scenario with a robot in it has 7
BREAKS = "\x85\u2028\u2029\ufeff"  # line breaks and marks of Unicode that must be escaped
MAX_DIGITS = 4000  # Python converts no longer integers
CONSTANTS = {"": None, "~": None, "true": True, "false": False, "null": None}
INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
SPECIAL = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")


def read_yaml(path: str | Path) -> Any:
    """`parse_yaml` of a file."""
    return parse_yaml(read_bytes(path), path)


def parse_yaml(data: bytes, source: str | Path) -> Any:
    """The content of a YAML file: mappings with text keys, lists and scalars.

    Raises:
        InputError: naming file and line, for text that is not YAML, or is too long, too deep or not plain data.
    """
    import yaml

    if len(data) > MAX_BYTES:
        raise refusal(str(source), f"{len(data)} bytes, more than {MAX_BYTES}")
    try:
        events = yaml.parse(data, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        return _document(events, str(source))
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
    if any(c in written for c in BREAKS):
        return yaml.dump(content, Dumper=Dumper, sort_keys=False)
    return written


def _document(events: Iterator[Any], source: str) -> Any:
    """The single document of a stream of YAML events, or None if there is none."""
    import yaml

    next(events)
    if isinstance(next(events), yaml.StreamEndEvent):
        return None
    content = _node(next(events), events, source, 0)
    next(events)
    if not isinstance(extra := next(events), yaml.StreamEndEvent):
        raise refusal(f"{source}, line {extra.start_mark.line + 1}", "not YAML (a second document)")
    return content


def _node(event: Any, events: Iterator[Any], source: str, depth: int) -> Any:
    """The value that begins with an event; the events up to its end are used up."""
    import yaml

    where = f"{source}, line {event.start_mark.line + 1}"
    if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
        raise refusal(where, "not YAML of this kind: anchors and aliases are refused")
    if event.tag is not None:
        raise refusal(where, f"not YAML of this kind: the tag {shown(event.tag)} is refused")
    if depth > MAX_DEPTH:
        raise refusal(where, f"not YAML of this kind: nested more than {MAX_DEPTH} deep")
    if isinstance(event, yaml.ScalarEvent):
        return _scalar(event.value) if event.style in (None, "") else event.value
    if isinstance(event, yaml.SequenceStartEvent):
        items = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            items.append(_node(event, events, source, depth + 1))
        return items
    content: dict[str, Any] = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        where = f"{source}, line {event.start_mark.line + 1}"
        if not isinstance(event, yaml.ScalarEvent):
            raise refusal(where, "not YAML of this kind: a key is no name")
        _node(event, events, source, depth)
        if event.value in content:
            raise refusal(where, f"key {shown(event.value)} comes twice")
        content[event.value] = _node(next(events), events, source, depth + 1)
    return content


def _scalar(text: str) -> Any:
    """A plain scalar by the core schema of YAML 1.2; a number too large for its type stays text."""
    if text in CONSTANTS or text in ("True", "TRUE", "False", "FALSE", "Null", "NULL"):
        return CONSTANTS[text.lower()]
    if INTEGER.fullmatch(text) and len(text) < MAX_DIGITS:
        return int(text, {"0o": 8, "0x": 16}.get(text[:2], 10))
    if FLOAT.fullmatch(text) and math.isfinite(float(text)):
        return float(text)
    return float(text.replace(".", "")) if SPECIAL.fullmatch(text) else text
