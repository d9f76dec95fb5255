"""Healthy robots of the model itself: every number that may scatter drawn anew, and logs of them, noise and rounding
on.
"""

from __future__ import annotations

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot
from exodrake.data.case import Case, CaseLog
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

SCATTER, SCATTER_ANGLE, CLIP = 0.03, 0.01, 2.5  # relative; rad, for angles near 0; standard deviations
EXACT = (
    "sensor.sigma_F",
    "sensor.q_F",
    "encoder",
    "mocap",
    "controller",
    "motor.N",
    "motor.r_set",
    "tendon.presliding",
)


def scattered(robot: Robot, rng: np.random.Generator) -> Robot:
    """A healthy robot: every number that may scatter drawn anew."""
    values = robot.values.copy()
    for i, parameter in enumerate(robot.machine.parameters):
        if parameter.null is not None or parameter.name.startswith(EXACT):
            continue
        draw = float(np.clip(rng.standard_normal(), -CLIP, CLIP))
        values[i] += SCATTER_ANGLE * draw if parameter.name.startswith("finger.q_e") else SCATTER * draw * values[i]
    return Robot(robot.machine, values, limits=robot.limits, source="scattered")


def healthy_case(nominal: Robot, seed: int) -> Case:
    """Logs of a healthy robot: short sweeps, a chirp and holds to fit, random motion held out."""
    rng = np.random.default_rng(seed)
    robot = scattered(nominal, rng)
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
