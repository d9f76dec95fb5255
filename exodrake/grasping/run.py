"""A plan in the Drake Diagram, with the joint-angle estimator in slot 8 and, if wanted, a posture loop around it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.core.signal import Axes
from exodrake.data.log import Log
from exodrake.grasping.plan import Plan
from exodrake.physics.gp_estimator import Weights

if TYPE_CHECKING:
    from exodrake.systems.posture_controller import PostureController


class TrainedEstimator(Protocol):
    """Interface of an estimator in a run: its channels and the arrays of its prediction."""

    @property
    def wires(self) -> tuple[str, ...]:
        """Names of the tendons."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        ...

    @property
    def weights(self) -> Weights:
        """Arrays of the prediction."""
        ...


def run_plan(
    plan: Plan,
    robot: Robot,
    estimator: TrainedEstimator,
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
    from exodrake.simulation.diagram_log import log_of_run
    from exodrake.systems.gp_estimator import GPEstimator

    check_axes(estimator, robot.machine.axes)
    reference = plan.reference(robot, **durations)
    systems = [GPEstimator(estimator.weights, robot.machine), *([controller] if controller else [])]
    diagram = build_diagram(robot, reference, seed, systems=systems)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(robot.machine.frame * len(reference.values))
    signals = logged_signals(diagram, simulator.get_context())
    log = log_of_run(diagram, simulator.get_context(), signals)
    for kind in ("angle_est", "angle_std", *(["angle_ref"] if controller else [])):
        log = log.with_array(kind, estimator.joints, signals[kind])
    return log


def check_axes(estimator: TrainedEstimator, axes: Axes) -> None:
    """Raises InputError for an estimator of other tendons or joints."""
    if (estimator.wires, estimator.joints) != (axes.tendons, axes.joints):
        raise InputError(f"estimator of tendons {', '.join(estimator.wires)}, joints {', '.join(estimator.joints)}")
