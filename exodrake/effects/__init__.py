"""The effect library, a module for each effect: errors of signals in `signal/`, friction laws in `friction/`.

Where several effects act at one point, they act in the order of their field `order`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from pkgutil import walk_packages

from exodrake.core import plugins
from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.errors import InputError, nearest
from exodrake.core.part import Part, points_of

plugins.extend(__path__, "effects")


def discover(package: str) -> tuple[Effect, ...]:
    """Effects that the modules of a package define, in the order in which they act.

    Args:
        package: name of an importable package; its sub-packages are searched, too.

    Raises:
        InputError: for two effects of one id.
    """
    found: dict[str, tuple[Effect, str]] = {}
    for info in walk_packages(import_module(package).__path__, f"{package}."):
        with plugins.shown_errors():
            module = import_module(info.name)
        for value in vars(module).values():
            if not isinstance(value, Effect):
                continue
            other, home = found.setdefault(value.id, (value, info.name))
            if other is not value:
                raise InputError(f"effect {value.id!r} is defined in both {home} and {info.name}")
    return in_order(effect for effect, _ in found.values())


def in_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Effects in the order in which they act at one point."""
    return tuple(sorted(effects, key=lambda effect: (effect.order, effect.id)))


LIBRARY = {effect.id: effect for effect in discover(__name__)}


def effects_of(parts: Iterable[Part]) -> tuple[Effect, ...]:
    """Effects of the library whose points are all points of these parts, in the order in which they act."""
    points = set(points_of(parts))
    return tuple(effect for effect in LIBRARY.values() if set(effect.at) <= points)


def for_machine(
    library_id: str, identity: str, points: Mapping[str, str] | None = None, **parameters: EffectParameter
) -> Effect:
    """The same law on another machine, under its own id; its parameters do not count as of `same_meaning`.

    Args:
        library_id: id in the library.
        identity: id on the machine.
        points: the machine's own point for each point of the effect that has another name there.
        parameters: parameters, by name, that replace those of the library (another range or axis).

    Raises:
        InputError: for an id that the library does not have.
    """
    if library_id not in LIBRARY:
        raise InputError(f"unknown effect {library_id!r}{nearest(library_id, list(LIBRARY))}")
    effect, moved = LIBRARY[library_id], dict(points or {})
    return replace(
        effect,
        id=identity,
        at={moved.get(point, point): function for point, function in effect.at.items()},
        parameters=tuple(parameters.get(n.name, n) for n in effect.parameters),
        advances=tuple(moved.get(point, point) for point in effect.advances),
        same_meaning=False,
    )
