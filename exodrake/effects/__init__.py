"""The effect library, a module for each effect: errors of signals in `signal/`, friction laws in `friction/`.

Those called `signal.*` and `sliding.*` are generic: they suit any sensor's signal and any sliding or turning part, and
each part with standard points gets them (`Point.standard`).

Where several effects act at one point, they act in the order of their field `order`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from pkgutil import walk_packages

from exodrake.core import plugins
from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.errors import InputError, nearest
from exodrake.core.part import Part, module_name, points_of

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
    """Effects of these parts, in the order in which they act: those made for their points, and the generic ones."""
    parts = tuple(parts)
    points = set(points_of(parts))
    own = [effect for effect in LIBRARY.values() if set(effect.at) <= points]
    return in_order([*own, *(effect for part in parts for effect in generic_effects(part))])


def plugin_effects(parts: Iterable[Part]) -> tuple[Effect, ...]:
    """Effects of plugins made for points of these parts, for a machine that lists those of the library itself."""
    points, own = set(points_of(parts)), str(plugins.PACKAGE)
    homes = {e.id: sys.modules[next(iter(e.at.values())).__module__].__file__ or own for e in LIBRARY.values()}
    return tuple(e for e in LIBRARY.values() if set(e.at) <= points and not homes[e.id].startswith(own))


def generic_effects(part: Part) -> tuple[Effect, ...]:
    """The generic effects (`signal.*`, `sliding.*`) of a part's standard points, under ids of the part.

    Ranges and units follow from the part's `scales`, and each channel of the part gets parameters of its own.
    """
    places = {p.standard: (f"{module_name(p.module or part.module)}.{p.name}", p.axis) for p in part.points}
    found = (effect for effect in LIBRARY.values() if set(effect.at) <= set(places))
    return tuple(on_part(effect, part, places) for effect in found)


def on_part(effect: Effect, part: Part, places: Mapping[str, tuple[str, str]]) -> Effect:
    """A generic effect on a part; places: its own point and the axis for each standard point."""
    axis = places[next(iter(effect.at))][1]
    parameters = {p.name: scaled(p, axis, *part.scales.get(p.unit, (1.0, p.unit))) for p in effect.parameters}
    points = {standard: places[standard][0] for standard in effect.at}
    states = tuple(replace(s, axis=axis, unit=part.scales.get(s.unit, (1.0, s.unit))[1]) for s in effect.states)
    return replace(
        for_machine(effect.id, f"{part.name}.{effect.id.split('.')[1]}", points, **parameters), states=states
    )


def scaled(parameter: EffectParameter, axis: str, size: float, unit: str) -> EffectParameter:
    """A generic effect's parameter on an axis, in units of `size` [unit]."""
    default = None if parameter.default is None else size * parameter.default
    ends = {"null": size * parameter.null, "low": size * parameter.low, "high": size * parameter.high}
    return replace(parameter, unit=unit, axis=axis, default=default, **ends)


def for_machine(
    library_id: str, identity: str, points: Mapping[str, str] | None = None, **parameters: EffectParameter
) -> Effect:
    """The same law on another machine, under its own id.

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
        filters=tuple(moved.get(point, point) for point in effect.filters),
    )
