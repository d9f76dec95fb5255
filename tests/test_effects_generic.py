"""Generic effects of any signal and any sliding part: closed forms, identities, and every machine that has them."""

from dataclasses import replace
from inspect import signature

import numpy as np
import pytest
from effects_motion import motion_of
from scipy.signal import lfilter

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.effects import LIBRARY, friction, generic_effects, signal
from exodrake.engine.compose import choose_context
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import machine_folders
from exodrake.model.effect import Effect
from exodrake.model.part import Part
from exodrake.simulation.simulate import record

PERIOD = 0.02
SIGNAL = np.sin(2 * np.pi * 0.7 * PERIOD * np.arange(400))
SPREAD = {"emps": 1e-6}  # m; by what a log must change; else 1e-4 rad


def course(law, values, *parameters, states: int) -> np.ndarray:
    """What a filter shows of a course of values (samples,)."""
    own, shown, named = (0.0,) * states, [], signature(law).parameters
    for k, value in enumerate(values):
        point = {"clock": PERIOD * k, "period": PERIOD if k else 0.0}
        found, *rest = law(value, *(point[name] for name in point if name in named), *parameters, *own)
        own = tuple(rest)
        shown.append(found)
    return np.array(shown)


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 2.75, 8.0])
def test_a_delay_shifts_a_straight_line_by_fractions_of_a_sample(samples: float) -> None:
    """Mixing two neighbours is exact for a line; a sine of slow phase is late by the delay, too."""
    line = 3.0 * PERIOD * np.arange(40)
    assert course(signal.delay, line, samples * PERIOD, states=8)[8:] == pytest.approx(
        (line - 3.0 * samples * PERIOD)[8:]
    )
    late = course(signal.delay, SIGNAL, samples * PERIOD, states=8)[8:]
    assert late == pytest.approx(np.sin(2 * np.pi * 0.7 * PERIOD * (np.arange(400) - samples))[8:], abs=2e-3)


def test_a_delay_ends_at_eight_samples_and_starts_with_the_first_value() -> None:
    line = np.arange(20.0)
    assert course(signal.delay, line, 11.0 * PERIOD, states=8)[10:] == pytest.approx(line[10:] - 8.0)
    assert course(signal.delay, line + 5.0, 3.0 * PERIOD, states=8)[:3] == pytest.approx([5.0, 5.0, 5.0])


@pytest.mark.parametrize("skew", [2e-3, -2e-3])
def test_a_skewed_clock_stretches_time(skew: float) -> None:
    shown = course(signal.skew_clock, SIGNAL, skew, states=8)
    time = PERIOD * np.arange(400)
    assert shown == pytest.approx(np.sin(2 * np.pi * 0.7 * (1.0 - skew) * time), abs=6e-3)


def test_low_pass_is_the_filter_of_scipy() -> None:
    decay = np.exp(-PERIOD / 0.1)
    wanted = lfilter([1.0 - decay], [1.0, -decay], SIGNAL, zi=[decay * SIGNAL[0]])[0]
    assert course(signal.low_pass, SIGNAL, 0.1, states=1) == pytest.approx(wanted)


def test_backlash_and_hysteresis_enclose_the_area_of_their_loops() -> None:
    values = np.sin(np.linspace(0.0, 4 * np.pi, 8001))
    cycle = slice(4000, None)
    play = course(signal.backlash, values, 0.1, states=1)
    assert abs(np.trapezoid(play[cycle], values[cycle])) == pytest.approx(4.0 * 0.1 * 0.9, rel=1e-3)
    loop = course(signal.hysteresis, values, 0.05, 0.02, states=2)
    assert abs(np.trapezoid(loop[cycle], values[cycle])) == pytest.approx(4.0 * 0.05 * (1.0 - 0.02), rel=1e-2)


def test_friction_of_the_load_is_a_share_of_the_drive() -> None:
    """A part of 2 kg driven by 10 N with a fifth of it lost moves as under 8 N, and never starts by itself."""
    mass, dt, v = 2.0, 1e-3, 0.0
    for _ in range(500):
        v = friction.brake_by_load(v + dt * 10.0 / mass, dt / mass, 10.0, 0.2)
    assert v == pytest.approx(0.5 * 8.0 / mass)
    assert friction.brake_by_load(1e-6, dt / mass, 10.0, 0.2) == 0.0
    assert friction.coulomb(-1e-6, dt / mass, 2.0) == 0.0
    slow, fast = (1.0 - friction.stribeck(1.0, 1e-3, 5.0, 2.0, s) for s in (10.0, 0.1))
    assert (slow, fast) == (pytest.approx(1e-2, rel=0.02), pytest.approx(5e-3))


def test_lugre_of_a_part_slides_at_its_level_and_holds_below_it() -> None:
    law, mass, dt = (15.0, 1.5, 0.01, 1e-4, 400.0), 10.0, 1e-4

    def end(drive: float) -> tuple[float, float]:
        v, z = 0.0, 0.0
        for k in range(20_000):  # the drive comes up within a tenth of a second
            v += dt * friction.lugre_force(drive * min(k * 1e-3, 1.0), v, *law, z) / mass
            z = friction.settle_lugre(dt, v * dt, *law, z)
        return v, z

    held, moved = end(18.0), end(30.0)
    assert held == (pytest.approx(0.0, abs=1e-9), pytest.approx(18.0 / 15.0 * 1e-4))
    assert moved[0] == pytest.approx((30.0 - 15.0) / mass * 1.95, rel=0.02)


MACHINES = [name for name in machine_folders() if name != "exo_index"]
EVERY = [(name, effect) for name in MACHINES for effect in exo.load_robot(name).machine.effects]
every = pytest.mark.parametrize("name, effect", EVERY, ids=[f"{name}-{effect.id}" for name, effect in EVERY])


def log_of(name: str, effect: Effect | None = None, **parameters: float) -> np.ndarray:
    """Compared signals of a run without noise and rounding (samples,)."""
    robot = exo.load_robot(name)
    robot = robot.with_parameters(dict.fromkeys(robot.machine.noise, 0.0))
    robot = robot.splice(effect.id, parameters) if effect else robot
    frames = 900 if name == "emps" else 150
    signals = record(robot, Reference(motion_of(name)[:frames]), seed=3, quantisation=False).signals
    kinds = [robot.machine.column(kind).signal for kind in robot.machine.compared]
    return np.concatenate([signals[kind].ravel() for kind in kinds])


@every
def test_absent_at_its_null_value(name: str, effect: Effect) -> None:
    """To the last bit, whatever its other parameters are."""
    first, *others = effect.parameters
    found = log_of(name, effect, **{first.name: first.null}, **{p.name: p.high for p in others})
    assert np.array_equal(found, log_of(name))


@every
def test_finite_and_visible_at_default_and_at_both_ends_of_every_range(name: str, effect: Effect) -> None:
    plain = log_of(name)
    cases = [{}] + [{p.name: value} for p in effect.parameters for value in (p.low, p.high)]
    for parameters in cases:
        found = log_of(name, effect, **parameters)
        assert np.isfinite(found).all()
        if not (effect.id == "sheath.capstan_play" and set(parameters) <= {"mu", "spread"} and parameters):
            assert np.abs(found - plain).max() > SPREAD.get(name, 1e-4), parameters


def test_each_sensor_has_the_whole_family_of_a_signal() -> None:
    """Crosstalk takes two channels; the carriage has the whole family of friction."""
    families = {kind: {i.split(".")[1] for i in LIBRARY if i.startswith(f"{kind}.")} for kind in ("signal", "sliding")}
    assert len(families["signal"]) == 13 and len(families["sliding"]) >= 7
    parts = {part.name: part for name in MACHINES for part in exo.load_robot(name).machine.parts}

    def laws(part: Part) -> set[str]:
        return {effect.id.split(".")[1] for effect in generic_effects(part)}

    assert laws(parts["scale"]) == families["signal"] - {"crosstalk"}
    assert laws(parts["carriage"]) == families["sliding"]


def test_two_sensors_of_one_machine_have_effects_of_their_own() -> None:
    """Points, ids, units and ranges are those of each sensor."""
    from exodrake.physics.reading import sensor

    one, other = (
        sensor(name, ("a", "b", "c", name), unit, 1, 0.01, size, 2)
        for name, unit, size in (("p", "m", 2.0), ("q", "A", 3.0))
    )
    found = {effect.id: effect for part in (one, other) for effect in generic_effects(part)}
    assert "p.backlash" in found and not {"q.backlash", "q.dead_zone"} & set(found)  # play is of travels
    assert found["p.offset"].at.keys() == {"reading_p.shown"} and found["q.offset"].at.keys() == {"reading_q.shown"}
    assert [found[i].parameters[0].unit for i in ("p.offset", "q.offset", "q.drift")] == ["m", "A", "A/s"]
    assert found["q.offset"].parameters[0].high == pytest.approx(0.9)


def neighbour_twice(aim, behind, share):
    """Takes one of the point's arguments, by its name."""
    return aim + 2.0 * share * behind


def mistaken(aim, neighbour, share):
    """Takes an argument that the point does not have."""
    return aim + share * neighbour


def test_a_law_takes_of_its_point_what_it_names_and_is_refused_for_what_the_point_lacks() -> None:
    fits, lacks = (replace(LIBRARY["joint.gain"], at={"joint.aimed": f}) for f in (neighbour_twice, mistaken))
    given = ["ahead", "behind", "setting"]
    assert choose_context(fits, "joint.aimed", given, 1) == ["behind"]
    assert choose_context(replace(lacks, names={"neighbour": "ahead"}), "joint.aimed", given, 1) == ["ahead"]
    with pytest.raises(InputError, match=r"mistaken\(aim, neighbour, share\) does not fit joint.aimed"):
        choose_context(lacks, "joint.aimed", given, 1)
