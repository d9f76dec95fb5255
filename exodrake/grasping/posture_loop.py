"""A posture loop around a grasp: object -> posture -> tensions -> tension control, with the estimated angles fed back.

controller = posture_controller(plan, robot)
log = run_plan(plan, wearer, estimator, controller=controller)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.errors import argument
from exodrake.core.robot import Robot
from exodrake.grasping.inverse_statics import stiffness
from exodrake.grasping.plan import Plan
from exodrake.physics.finger_statics import arms, parameters_of
from exodrake.physics.posture_controller import damped_inverse
from exodrake.simulation.simulate import record

if TYPE_CHECKING:
    from exodrake.systems.posture_controller import PostureController

KI = 0.5  # 1/s: a quarter of the tension loop's bandwidth, which settles in 1.8 s; assumed


def compliance(plan: Plan, robot: Robot) -> np.ndarray:
    """dq/dF (joints, tendons) [rad/N] of the nominal finger in the planned posture."""
    n, angle, tension = parameters_of(robot), np.array([plan.planned]), np.array([plan.tensions])
    return arms(angle, n)[0].T / stiffness(angle, tension, n)[0][:, None]


def posture_controller(plan: Plan, robot: Robot, ki: float = KI, **durations: float) -> PostureController:
    """The posture controller of a planned grasp.

    Args:
        plan: from `plan_grasp`.
        robot: as its robot file describes it; the wearer may differ.
        ki: [1/s]; 0 leaves the planned tensions as they are.
        durations: of the grasp, as in `exo.grasp` [s].
    """
    from exodrake.systems.posture_controller import PostureController, PosturePlan

    reference = argument("plan", plan, Plan).reference(argument("robot", robot, Robot), **durations)
    angle = record(robot.without_effects(), reference, seed=None, quantisation=False).signals["angle"]
    low, high = robot.reference_limits()
    gain = damped_inverse(compliance(plan, robot))
    return PostureController(PosturePlan(reference.values, angle, gain, low, high, ki), robot.machine)
