"""Check of a plan by simulation: the nominal robot, without noise, must stand in the planned posture at the hold.

Statics do not contain the tension loop, which is slow where the finger is soft, nor a joint that stays long near the
first of two equilibria.
"""

from __future__ import annotations

import numpy as np

from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.simulation.protocols import grasp
from exodrake.simulation.simulate import log_of, run

REST, APPROACH, HOLD = 0.5, 1.0, 2.5  # s
LAST = 0.5  # s at the end of the hold, over which a posture is read
CLOSE = 0.03  # rad between plan and simulation


def at_hold(log: Log, kind: str, names: tuple[str, ...]) -> np.ndarray:
    """Means (n,) [SI] of columns over the last half second of the hold of a grasp."""
    during = (log.time >= REST + APPROACH + HOLD - LAST) & (log.time < REST + APPROACH + HOLD)
    return log.array(kind, names)[during].mean(axis=0)


def confirmed(robot: Robot, tension: np.ndarray, angles: np.ndarray) -> bool:
    """Whether references of these tensions (tendons,) [N] bring a robot to these angles (joints,) [rad]."""
    axes = robot.machine.axes
    targets = dict(zip(axes.tendons, np.asarray(tension, dtype=float).tolist()))
    log = log_of(run(robot, grasp("trial", robot, targets, rest=REST, approach=APPROACH, hold=HOLD), seed=None))
    return bool(np.abs(at_hold(log, "angle", axes.joints) - angles).max() <= CLOSE)
