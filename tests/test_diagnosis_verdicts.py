"""Verdicts on a few robots with planted effects, judged together: a single case proves little either way.

Robots are drawn within their tolerances, logs carry noise and rounding, the held-out motion is of another kind.
`exodrake blind` is the real exam, in a reality that shares no equation with the model; this one keeps the way there
open.
"""

import numpy as np
import pytest

from exodrake.compiled.inputs import Reference
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis import diagnose
from exodrake.diagnosis.healthy import healthy_robot
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

FRAMES = 900  # 18 s a log
PLANTED = {
    "timing.command_latency": {"frames": 2.0},
    "tendon.capstan_friction": {"mu_phi": 0.3},
    "finger.contact": {"distance": 0.045, "stiffness": 2000.0},
    "motor.slow_velocity_loop": {"factor": 0.35},
}
HEALTHY = (101, 102)  # the second meets an end stop in the held-out log only


def case_of(robot, seed):
    """Sweeps and holds to fit, random motion held out."""
    plan = (
        ("sweeps", "fit", protocols.short_sweeps(robot)),
        ("holds", "fit", protocols.holds(robot, seed=seed)),
        ("random", "holdout", protocols.random_motion(robot, seed=seed)),
    )
    logs = [
        CaseLog(simulate(robot, Reference(ask.tension[:FRAMES], name), seed=10 * seed + k), name, role, None, name)
        for k, (name, role, ask) in enumerate(plan)
    ]
    return Case(f"case {seed}", {}, tuple(logs))


@pytest.fixture(scope="module")
def nominal():
    return load_robot()


def test_planted_effects_are_named(nominal):
    right = 0
    for seed, (identity, parameters) in enumerate(PLANTED.items()):
        robot = healthy_robot(nominal, np.random.default_rng(seed)).splice(identity, parameters)
        answer = diagnose(case_of(robot, seed), nominal)
        right += identity in {effect.id for effect in answer.effects} | set(answer.equivalents)
    assert right >= len(PLANTED) - 1  # at 90 % right each, as wanted, fewer are right in 5 % of such quartets


def test_healthy_robots_raise_no_alarm(nominal):
    verdicts = [
        diagnose(case_of(healthy_robot(nominal, np.random.default_rng(seed)), seed), nominal).verdict
        for seed in HEALTHY
    ]
    assert set(verdicts) <= {"NO_GAP", "RETUNE"}
