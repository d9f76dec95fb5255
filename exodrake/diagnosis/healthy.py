"""Healthy robots: parameters drawn within the tolerances of the robot file, no effect, and logs of such robots.

Simulated healthy robots calibrate false alarms, those of the diagnosis and those of the monitor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.parameter import apply, nominal_parameters
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate


def healthy_robot(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with each parameter that has a tolerance drawn anew, normal and clipped to its largest deviation."""
    parameters = nominal_parameters(robot)
    low, high = np.array([p.bounds for p in parameters]).reshape(-1, 2).T
    drawn = rng.standard_normal(len(parameters)) * [p.prior_std for p in parameters]
    return replace(robot, values=apply(robot.values, parameters, np.clip(drawn, low, high)), source="healthy")


def healthy_case(nominal: Robot, seed: int) -> Case:
    """Logs of a healthy robot: short sweeps, a chirp and holds to fit, random motion held out."""
    robot = healthy_robot(nominal, np.random.default_rng(seed))
    plan: tuple[tuple[str, str, Reference], ...] = (
        ("sweeps", "fit", protocols.short_sweeps(nominal)),
        ("chirp", "fit", protocols.chirp(nominal)),
        ("holds", "fit", protocols.holds(nominal, seed=seed)),
        ("random", "holdout", protocols.random_motion(nominal, seed=seed)),
    )
    logs = [
        CaseLog(simulate(robot, reference, seed=1000 * seed + k), name, role, None, f"{name}.csv")
        for k, (name, role, reference) in enumerate(plan)
    ]
    return Case(f"healthy {seed}", {}, tuple(logs))
