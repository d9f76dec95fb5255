"""The exam of every effect: absent at its null value, finite over its range and in pairs, visible at its defaults."""

from functools import cache

import numpy as np
import pytest
from effects_motion import nominal, place, row_of, run_rows

from exodrake.machines.exo_index.machine import machine as exo_index
from exodrake.model.effect import Effect

EFFECTS = exo_index().effects
PERIOD = 0.02
NOISE_STD = {"tension_read": 0.01, "stroke_read": 12.3e-6, "angle_read": 0.005, "mocap_delay": 0.005}
BOUNDS = {"tension": 500.0, "tension_finger": 500.0, "stroke": 0.5, "angle": 6.0, "rate": 1e3, "tension_read": 500.0}
DRAWS = 20

in_the_library = pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.id)


@cache
def plain() -> np.ndarray:
    """Record of the nominal robot (frames, signals)."""
    return run_rows([row_of(nominal())])[0]


def drawn(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Parameters drawn from the whole of their ranges, ends included."""
    where = rng.choice((0.0, 1.0, rng.random()), size=len(effect.parameters))
    return {n.name: float(n.low + x * (n.high - n.low)) for n, x in zip(effect.parameters, where)}


def check(record: np.ndarray) -> None:
    """Finite and bounded."""
    assert np.isfinite(record).all()
    for name, bound in BOUNDS.items():
        assert np.abs(record[:, place(name)]).max() < bound, name


@in_the_library
def test_absent_at_its_null_value(effect: Effect) -> None:
    """At the first parameter's null value the record is the plain robot's to the last bit, whatever the others are."""
    first, rng = effect.parameters[0], np.random.default_rng(1)
    rows = [row_of(nominal().splice(effect.id, {**drawn(effect, rng), first.name: first.null})) for _ in range(2)]
    for record in run_rows(rows):
        assert np.array_equal(record, plain())


@in_the_library
def test_finite_over_its_range(effect: Effect) -> None:
    """Draws from the whole range, on all channels and on one, stay finite and bounded in an aggressive motion."""
    rng = np.random.default_rng(list(effect.id.encode()))
    channels = nominal().machine.axes.of(effect.axis)
    some = [channels if k % 2 else (channels[k % len(channels)],) for k in range(DRAWS)]
    rows = [row_of(nominal().splice(effect.id, drawn(effect, rng), [s for s in own if s])) for own in some]
    for record in run_rows(rows):
        check(record)


def seen_by(record: np.ndarray) -> dict[str, np.ndarray]:
    """What a log would show of a record: late samples count by the angle that they miss."""
    shown = {name: record[:, place(name)] for name in NOISE_STD}
    late = shown.pop("mocap_delay")
    rate = np.gradient(shown["angle_read"], PERIOD, axis=0)
    return {**shown, "angle_read": shown["angle_read"] - rate * late}


def gap(effect: Effect, parameters: dict[str, float]) -> float:
    """RMS difference from the plain robot's log, in noise standard deviations of the column that shows it best."""
    record = run_rows([row_of(nominal().splice(effect.id, parameters))])[0]
    check(record)
    with_it, without = seen_by(record), seen_by(plain())
    gaps = {name: np.sqrt(np.mean((with_it[name] - without[name]) ** 2, axis=0)).max() for name in with_it}
    return max(gap / NOISE_STD[name] for name, gap in gaps.items())


@in_the_library
def test_visible_at_its_defaults_and_at_both_ends_of_every_range(effect: Effect) -> None:
    """By default some column of the log moves by half its noise standard deviation (RMS), at an end by a tenth."""
    assert gap(effect, {}) > 0.5
    for parameter in effect.parameters:
        for value in (parameter.low, parameter.high):
            assert gap(effect, {parameter.name: value}) > 0.1, (parameter.name, value)


def test_pairs_and_all_at_once_are_finite() -> None:
    """Pairs of effects drawn from their ranges, and every effect at its default values."""
    robots = []
    for draw in range(150):
        rng, robot = np.random.default_rng(1000 + draw), nominal()
        for k in rng.choice(len(EFFECTS), size=2, replace=False):
            robot = robot.splice(EFFECTS[k].id, drawn(EFFECTS[k], rng))
        robots.append(robot)
    robot = nominal()
    for effect in EFFECTS:
        robot = robot.splice(effect.id)
    for record in run_rows([row_of(one) for one in (*robots, robot)]):
        check(record)


def test_library_is_well_formed() -> None:
    """Ids are unique, points exist, functions are described, states are advanced, initial values lie in range."""
    machine = nominal().machine
    points = {f"{(p.module or b.module).__name__.rsplit('.', 1)[-1]}.{p.name}" for b in machine.parts for p in b.points}
    assert len({e.id for e in EFFECTS}) == len(EFFECTS)
    for effect in EFFECTS:
        assert set(effect.at) <= points, effect.id
        assert set(effect.advances) <= set(effect.at)
        assert bool(effect.states) == bool(effect.advances or effect.filters), effect.id
        for text in (effect.summary, effect.signature, effect.source, effect.family):
            assert text
        for function in effect.at.values():
            assert function.__doc__
        for parameter in effect.parameters:
            assert parameter.low <= parameter.initial <= parameter.high, (effect.id, parameter.name)
