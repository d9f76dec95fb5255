"""A plan in the Drake Diagram, with the joint-angle estimator in slot 8 and, if wanted, a posture loop around it.

controller = posture_controller(plan, robot)
log = run_plan(plan, wearer, estimator, controller=controller)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.errors import InputError, argument
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.grasping.plan import Plan, stiffness
from exodrake.physics.finger_statics import arms, parameters_of
from exodrake.simulation.simulate import record

if TYPE_CHECKING:
    from exodrake.estimator.gp import Estimator
    from exodrake.systems.posture_controller import PostureController


KI = 0.5  # 1/s: a quarter of the tension loop's bandwidth, which settles in 1.8 s; assumed


def posture_controller(plan: Plan, robot: Robot, ki: float = KI, **durations: float) -> PostureController:
    """The posture controller of a planned grasp.

    Args:
        plan: from `plan_grasp`.
        robot: as its robot file describes it; the wearer may differ.
        ki: [1/s]; 0 leaves the planned tensions as they are.
        durations: of the grasp, as in `exo.grasp` [s].
    """
    from exodrake.systems.posture_controller import PostureController, PosturePlan, damped_inverse

    reference = argument("plan", plan, Plan).reference(argument("robot", robot, Robot), **durations)
    angle = record(robot.without_effects(), reference, seed=None, quantisation=False).signals["angle"]
    low, high = robot.reference_limits()
    n, planned, tension = parameters_of(robot), np.array([plan.planned]), np.array([plan.tensions])
    compliance = arms(planned, n)[0].T / stiffness(planned, tension, n)[0][:, None]  # dq/dF [rad/N]
    gain = damped_inverse(compliance)
    return PostureController(PosturePlan(reference.values, angle, gain, low, high, ki), robot.machine)


def run_plan(
    plan: Plan,
    robot: Robot,
    estimator: Estimator,
    seed: int | None = 0,
    controller: PostureController | None = None,
    **durations: float,
) -> Log:
    """Simulates a robot in the Drake Diagram that follows a plan.

    Args:
        plan: from `plan_grasp`.
        robot: to be simulated, with or without effects.
        estimator: of the same tendons and joints.
        seed: of the sensors' noise; None simulates without.
        controller: from `posture_controller`, which then gives the tension references; None: those of the plan.
        durations: as in `exo.grasp` [s].

    Returns:
        The log, with `angle_est` and `angle_std` of the estimator, and `angle_ref` of the controller.

    Raises:
        InputError: the estimator has other tendons or joints.
    """
    from exodrake.diagrams.diagram import Simulator, build_diagram, logged_signals
    from exodrake.simulation.simulate import diagram_log
    from exodrake.systems.gp_estimator import GPEstimator

    axes = robot.machine.axes
    if (estimator.wires, estimator.joints) != (axes.tendons, axes.joints):
        raise InputError(f"estimator of tendons {', '.join(estimator.wires)}, joints {', '.join(estimator.joints)}")
    reference = plan.reference(robot, **durations)
    systems = [GPEstimator(estimator.weights, robot.machine), *([controller] if controller else [])]
    diagram = build_diagram(robot, reference, seed, systems=systems)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(robot.machine.frame * len(reference.values))
    signals = logged_signals(diagram, simulator.get_context())
    log = diagram_log(diagram, simulator.get_context(), signals)
    for kind in ("angle_est", "angle_std", *(["angle_ref"] if controller else [])):
        log = log.with_array(kind, estimator.joints, signals[kind])
    return log
