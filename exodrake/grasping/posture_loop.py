"""A posture loop around a grasp: object -> posture -> tensions -> tension control, with the estimated angles fed back.

controller = posture_controller(plan, robot)
log = run_plan(plan, wearer, estimator, controller=controller)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.grasping.inverse import stiffness
from exodrake.grasping.plan import Plan
from exodrake.simulation.simulate import record
from exodrake.systems.finger_statics import arms, parameters_of
from exodrake.systems.posture_controller import damped_inverse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from exodrake.diagrams.posture_controller import PostureController

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
    from exodrake.diagrams.posture_controller import PostureController, PosturePlan

    reference = plan.reference(robot, **durations)
    angle = record(robot.without_effects(), reference, seed=None, quantisation=False).signals["angle"]
    low, high = robot.reference_limits()
    gain = damped_inverse(compliance(plan, robot))
    return PostureController(PosturePlan(reference.tension, angle, gain, low, high, ki), robot.machine)


def posture_figure(plan: Plan, without: Log, with_loop: Log) -> Figure:
    """Angles and tension references of a grasp with the planned tensions alone, and with the posture loop."""
    import matplotlib

    from exodrake.data.plot import STYLE, new_figure

    with matplotlib.rc_context(STYLE):
        figure = new_figure(9.0, 5.2)
        panels = figure.subplots(2, 3, sharex=True, sharey="row")
        runs = (("planned tensions alone", without, "#8c8c8c"), ("posture loop", with_loop, "#0072b2"))
        for axes, joint in zip(panels[0], plan.joints, strict=True):
            axes.plot(with_loop.time, with_loop[f"angle_ref_{joint}"], color="#222222", ls="--", lw=1.2, label="wanted")
            for label, log, colour in runs:
                axes.plot(log.time, log[f"angle_{joint}"], color=colour, label=label)
            estimate = with_loop[f"angle_est_{joint}"]
            axes.plot(with_loop.time, estimate, color="#d55e00", lw=0.8, label="its estimate")
            axes.set_title(joint)
        for axes, tendon in zip(panels[1], plan.tendons, strict=True):
            for _, log, colour in runs:
                axes.plot(log.time, log[f"tension_ref_{tendon}"], color=colour)
            axes.set_title(tendon)
            axes.set_xlabel("Time [s]")
        panels[0, 0].set_ylabel("Angle [rad]")
        panels[1, 0].set_ylabel("Tension reference [N]")
        panels[0, 2].legend(loc="upper left", bbox_to_anchor=(1.0, 1.04), handlelength=1.8)
    return figure
