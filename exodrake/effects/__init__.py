"""The effect library, a file for each family: its laws as functions, then the effects that name where they act.

Those called `signal.*` and `sliding.*` are generic: they suit any sensor's signal and any sliding or turning part, and
each part with standard points gets them (`Point.standard`).

Where several effects act at one point, they act in the order in which `FAMILIES` and their files list them; those of
plugins follow, by their field `order` and their id.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from exodrake.core import plugins
from exodrake.core.errors import InputError, nearest
from exodrake.model.effect import Effect, EffectParameter
from exodrake.model.part import Part, map_points, point_key

plugins.extend(__path__, "effects")
FAMILIES = ("motor", "friction", "tendon", "sensor", "finger", "timing", "signal", "arm", "servo")


def discover() -> tuple[dict[str, Effect], tuple[Effect, ...]]:
    """All effects by id, in the order in which they act, and those of plugins among them."""
    for file in [file for place in __path__[1:] for file in Path(place).iterdir() if file.stem in FAMILIES]:
        raise InputError(f"{file}: the library has a file of this name; rename it")
    modules = [f"{__name__}.{family}" for family in FAMILIES]
    plugged = [info.name for info in walk_packages(__path__, f"{__name__}.") if info.name not in modules]
    found: dict[str, tuple[Effect, str]] = {}
    for name in (*modules, *plugged):
        with plugins.shown_errors():
            module = import_module(name)
        for effect in [value for value in vars(module).values() if isinstance(value, Effect)]:
            other, home = found.setdefault(effect.id, (effect, name))
            if other is not effect:
                raise InputError(f"effect {effect.id!r} is defined in both {home} and {name}")
    own = [effect for effect, home in found.values() if home in modules]
    others = in_order(effect for effect, home in found.values() if home in plugged)
    numbered = (replace(effect, order=number) for number, effect in enumerate(own))
    return {effect.id: effect for effect in in_order((*numbered, *others))}, others


def in_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Effects in the order in which they act at one point."""
    return tuple(sorted(effects, key=lambda effect: (effect.order, effect.id)))


LIBRARY, PLUGGED = discover()


def collect_effects(parts: Iterable[Part]) -> tuple[Effect, ...]:
    """Effects of these parts, in the order in which they act: those made for their points, and the generic ones.

    Ranges and units follow from the `scales` of the parts on which an effect acts.
    """
    parts = tuple(parts)
    points, own = map_points(parts), []
    for effect in (effect for effect in LIBRARY.values() if set(effect.at) <= set(points)):
        scales = {unit: one for point in effect.at for unit, one in points[point].scales.items()}
        parameters = tuple(p.resize(*scales[p.unit]) if p.unit in scales else p for p in effect.parameters)
        own.append(replace(effect, parameters=parameters))
    return in_order([*own, *(effect for part in parts for effect in generic_effects(part))])


def plugin_effects(parts: Iterable[Part], listed: Iterable[Effect]) -> tuple[Effect, ...]:
    """Effects of plugins made for points of these parts, for a machine that lists others itself."""
    points, known = set(map_points(parts)), {effect.id for effect in listed}
    return tuple(effect for effect in PLUGGED if set(effect.at) <= points and effect.id not in known)


def generic_effects(part: Part) -> tuple[Effect, ...]:
    """The generic effects (`signal.*`, `sliding.*`) of a part's standard points, under ids of the part.

    Ranges and units follow from the part's `scales` and `ranges`, and each channel of the part gets parameters of its
    own. Only sensors of travel have play or a coupling centred by a spring before them.
    """
    own = {p.standard: p for p in part.points}
    travels = part.scales.get("value", (1.0, ""))[1] in ("rad", "m")
    names = {standard: point_key(part, p) for standard, p in own.items()}
    found = []
    for effect in (effect for effect in LIBRARY.values() if set(effect.at) <= set(own)):
        if effect.id in ("signal.backlash", "signal.dead_zone") and not travels:
            continue
        axis, parameters = own[next(iter(effect.at))].axis, {}
        for p in effect.parameters:
            resized = p.resize(*part.scales.get(p.unit, (1.0, p.unit)))
            if p is effect.parameters[0] and effect.id in part.ranges:
                low, usual, high = part.ranges[effect.id]
                resized = replace(resized, low=low, default=usual, high=high)
            parameters[p.name] = replace(resized, axis=axis)
        states = tuple(replace(s, axis=axis, unit=part.scales.get(s.unit, (1.0, s.unit))[1]) for s in effect.states)
        one = for_machine(effect.id, f"{part.name}.{effect.id.split('.')[1]}", names, **parameters)
        found.append(replace(one, states=states))
    return tuple(found)


def for_machine(
    library_id: str, identity: str, points: Mapping[str, str] | None = None, **parameters: EffectParameter
) -> Effect:
    """The law of an id in the library on another machine, under its own id.

    `points`: the machine's own point for each that has another name there; `parameters` replace those of the library.
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
