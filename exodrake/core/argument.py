"""Types of the arguments of public functions."""

from __future__ import annotations

from exodrake.core.short_repr import brief


def argument[T](name: str, value: T, *types: type) -> T:
    """The value of an argument. TypeError naming argument, types wanted and value for one of another type."""
    if isinstance(value, types):
        return value
    wanted = " or ".join("None" if one is type(None) else one.__name__ for one in types)
    raise TypeError(f"{name}: wanted {wanted}, got {type(value).__name__} ({brief(value)})")
