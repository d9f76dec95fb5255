"""Short cases of simulated robots for the tests of the diagnosis, and their diagnoses, made once for all tests."""

from functools import cache

import numpy as np

from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import make_problem
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.model.robot import drawn_robot
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

FRAMES = 650  # 13 s a log
INJECTED = {"AF": 0.30, "MF": 0.20, "AE": 0.25}  # coefficients of capstan friction


def case_of(robot, seed=0, frames=FRAMES, name="case"):
    """Sweeps and holds to fit, random motion held out."""
    nominal = load_robot()
    plan = (
        ("sweeps", "fit", protocols.short_sweeps(nominal)),
        ("holds", "fit", protocols.holds(nominal, seed=seed)),
        ("random", "holdout", protocols.random_motion(nominal, seed=seed)),
    )
    logs = [
        CaseLog(simulate(robot, Reference(ask.values[:frames], name), seed=10 * seed + k), name, role, None, name)
        for k, (name, role, ask) in enumerate(plan)
    ]
    return Case(name, {}, tuple(logs))


def robot_with(identity="", seed=0, **parameters):
    """A robot of the tolerances, healthy or with an effect."""
    robot = drawn_robot(load_robot(), np.random.default_rng(seed))
    return robot.splice(identity, parameters) if identity else robot


@cache
def friction_problem():
    """The problem of 6 s of the nominal robot with friction, as the only log."""
    robot = load_robot()
    injected = robot.splice("tendon.capstan_friction", {"mu_phi": INJECTED})
    reference = Reference(protocols.random_motion(robot, seed=1).values[:300], "random")
    log = CaseLog(simulate(injected, reference, seed=1), "random", "fit", None, "random.csv")
    return make_problem(Case("friction", {}, (log,)), robot)


@cache
def friction_case():
    """A case of a robot with friction in the sheaths."""
    return case_of(robot_with("tendon.capstan_friction", 1, mu_phi=0.3), 1)


@cache
def friction_diagnosis():
    """Its diagnosis."""
    return diagnose(friction_case(), load_robot())


@cache
def healthy_diagnosis():
    """The diagnosis of a healthy robot, which meets an end stop in its held-out log only."""
    return diagnose(case_of(robot_with(seed=102), 102), load_robot())
