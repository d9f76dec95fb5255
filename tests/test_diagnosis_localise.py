"""Localisation: blocks of effects that are not tried, affected channels, conditions of a regime."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from effects_motion import motion_of

import exodrake as exo
from exodrake.core.parallel import one_blas_thread
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis import localise
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.localise import conditions, explain_variance, motion, remaining
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.result import CAUSE, REFINEMENT, Interval, NamedEffect
from exodrake.engine.inputs import Reference
from exodrake.simulation import protocols


def problem_of(robot, injected, frames=400):
    """Steps of a robot with an injected effect, as the only log."""
    reference = Reference(protocols.steps(robot, dwell=1.0).values[:frames], "steps")
    log = exo.simulate(injected, reference, seed=4)
    return make_problem(Case("steps", {}, (CaseLog(log, "steps", "fit", None, "steps.csv"),)), robot)


def place_without(robot, injected, reference):
    """The place of a gap whose effect is not tried."""
    log = exo.simulate(robot.splice(injected), reference, seed=4)
    tried = frozenset(e.id for e in robot.machine.effects if not e.not_tried and e.id != injected)
    case = Case("steps", {}, (CaseLog(log, "steps", "fit", None, "steps.csv"),))
    with one_blas_thread():
        found = isolate(make_problem(case, robot, tried))
    return remaining(found, found.retuned)


def test_place_of_named_effects_is_that_of_their_causes(monkeypatch):
    def effect(identity, wires, joints, role, share):
        return NamedEffect(identity, wires, joints, {}, {}, role=role, share=Interval(share, share, share))

    causes = effect("finger.tremor", (), ("MCP",), CAUSE, 0.9), effect("sensor.gain", ("AE",), (), CAUSE, 0.05)
    small = effect("motor.slow_velocity_loop", ("MF",), (), REFINEMENT, 0.02)
    monkeypatch.setattr(localise, "regime", lambda problem, robot: {"load": 0.5})
    found = SimpleNamespace(whole=None, retuned=SimpleNamespace(explanation=SimpleNamespace(robot=None)))
    place = localise.localise(found, "NAMED", (*causes, small))
    assert (place.block, place.wires, place.joints) == ("finger", ("AE",), ("MCP",))
    assert place.shares == pytest.approx({"finger": 0.9, "sensor": 0.05, "motor": 0.02})


@pytest.mark.parametrize(
    "injected, segment",
    [("motor.slow_velocity_loop", "motor"), ("tendon.compliance", "tendon"), ("finger.viscoelasticity", "finger")],
)
def test_an_error_of_one_segment_shows_in_its_replay_alone(robot, injected, segment):
    problem = problem_of(robot, robot.splice(injected))
    errors = localise.replay_segments(problem, problem.silent())
    most = {name: max(x for (s, _), x in errors.items() if s == name) for name, _ in errors}
    assert most.keys() == {"motor", "tendon", "finger"}
    assert max(most, key=most.__getitem__) == segment
    assert most[segment] > 10.0 > max(x for name, x in most.items() if name != segment)


@pytest.mark.parametrize(
    "injected, block",
    [
        ("sensor.creep", "sensor"),
        ("motor.dead_zone", "motor"),  # which no other effect imitates: the strokes have the largest prediction error
    ],
)
def test_effect_that_is_not_tried_is_found_in_its_block(robot, injected, block):
    place = place_without(robot, injected, Reference(protocols.steps(robot, dwell=1.0).values[:250], "steps"))
    assert (place.block, place.wires, place.joints) == (block, robot.machine.axes.tendons, ())


@pytest.mark.parametrize("injected, block", [("servo.dead_band", "servo"), ("reading.drift", "reading")])
def test_effect_of_a_servo_that_is_not_tried_is_found_in_its_block(injected, block):
    so101 = exo.load_robot("so101")
    place = place_without(so101, injected, Reference(motion_of("so101"), "motion"))
    assert place.block == block and place.joints == so101.machine.axes.joints and place.regime


def test_conditions_are_those_that_the_machine_declares(robot):
    problem = problem_of(robot, robot)
    trial = problem.fit[0]
    found = conditions(problem, trial, 1)
    np.testing.assert_array_equal(found["load"], trial.measured[:, problem.columns.index("tension_MF")])
    np.testing.assert_array_equal(found["joint angle"], trial.measured[:, problem.columns.index("angle_PIP")])
    np.testing.assert_array_equal(found["slack"], found["load"] < 0.15)
    so101 = exo.load_robot("so101")
    angle = np.linspace(0.0, 1.0, 400)[:, None] ** 2
    plain = replace(problem, robot=so101, columns=("angle_Pitch",))
    found = conditions(plain, replace(trial, measured=angle), 1)
    np.testing.assert_array_equal(found["position"], angle[:, 0])
    assert found["speed"][200] == pytest.approx(2 * (200 / 399) / 399 / so101.machine.frame, rel=0.02)
    assert set(found) == {"direction of motion", "speed", "position", "time since reversal", "time in trial"}


@pytest.mark.parametrize("position", [0.0, 1.5])
def test_direction_of_motion_does_not_depend_on_where_a_joint_is(position):
    """A slow sine about any angle: friction against its motion is explained by the direction."""
    time = 0.02 * np.arange(3000)
    angle, speed = position + 0.1 * np.sin(0.2 * np.pi * time), 0.02 * np.pi * np.cos(0.2 * np.pi * time)
    found = motion(angle, 15, None, 0.02)
    assert np.max(found["speed"]) == pytest.approx(0.02 * np.pi, rel=0.02)
    assert np.max(found["time since reversal"]) == pytest.approx(5.0, abs=0.1)  # half a period
    assert explain_variance(np.sign(speed), found["direction of motion"]) > 0.9
