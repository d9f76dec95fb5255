"""Values that are made once for an owner, where making them takes more than the owner."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def once[T](owner: Any, name: str, make: Callable[[], T]) -> T:
    """A value kept beside the fields of an instance, also of a frozen one, as `functools.cached_property` keeps one.

    Args:
        owner: an instance with a `__dict__`; a copy with other fields (`dataclasses.replace`) makes its own value.
        name: key of the value.
        make: makes it at first use.
    """
    if name not in owner.__dict__:
        owner.__dict__[name] = make()
    return owner.__dict__[name]
