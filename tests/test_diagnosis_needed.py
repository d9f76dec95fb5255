"""A larger set of effects speaks against a smaller one only where its effects are there."""

from collections import defaultdict

import pytest
from diagnosis_cases import FRAMES, case_of, robot_with

from exodrake.diagnosis.isolate import Isolator
from exodrake.diagnosis.part_used import SHARE
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.retune import retune
from exodrake.diagnosis.verdict import rejected
from exodrake.machines.robot_file import load_robot

TRIED = ("tendon.capstan_friction", "mocap.offset", "sensor.drift")


def pairs_of(robot):
    """The isolator of a robot with friction, and the isolation with a second effect beside the friction."""
    problem = make_problem(case_of(robot, 1, FRAMES // 2), load_robot(), frozenset(TRIED)).shortened(2 * SHARE)
    start, simulated = retune(problem)
    isolator = Isolator(problem, start, defaultdict(float, simulated))
    return isolator, isolator.grown(isolator.isolate(1))


@pytest.fixture(scope="module")
def friction():
    return robot_with("tendon.capstan_friction", 1, mu_phi=0.3)


def test_effects_that_are_not_there_are_not_needed_beside_friction(friction):
    isolator, larger = pairs_of(friction)
    assert larger.left and all(TRIED[0] in t.explanation.effects for t in larger.left)
    assert not isolator.needed(larger)


def test_an_offset_that_is_there_is_needed_beside_friction(friction):
    isolator, larger = pairs_of(friction.splice("mocap.offset", {"offset": 0.1}))
    assert larger.left[0].explanation.effects == TRIED[:2] and isolator.needed(larger)
    assert rejected(larger.left[0]).endswith("takes up too little of what a smaller one leaves")
