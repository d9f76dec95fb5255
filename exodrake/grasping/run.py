"""A plan in the Drake Diagram, with the joint-angle estimator running in slot 8."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import offsets
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.grasping.plan import Plan
from exodrake.simulation.simulate import Recording, log_of
from exodrake.systems.gp_estimator import Weights


class TrainedEstimator(Protocol):
    """What a run needs of an estimator: its channels and the arrays of its prediction."""

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


def run_plan(plan: Plan, robot: Robot, estimator: TrainedEstimator, seed: int | None = 0) -> Log:
    """Simulates a robot in the Drake Diagram that follows a plan.

    Args:
        plan: from `plan_grasp`.
        robot: to be simulated, with or without effects.
        estimator: of the same tendons and joints.
        seed: of the sensors' noise; None simulates without.

    Returns:
        The log, with `angle_est` and `angle_std` of the estimator.

    Raises:
        InputError: the estimator has other tendons or joints.
    """
    from exodrake.diagrams import diagram as drake

    axes, reference = robot.machine.axes, plan.reference(robot)
    if (estimator.wires, estimator.joints) != (axes.tendons, axes.joints):
        raise InputError(f"estimator of tendons {', '.join(estimator.wires)}, joints {', '.join(estimator.joints)}")
    diagram = drake.build_diagram(robot, reference, seed, estimator=estimator.weights)
    simulator, frames = drake.Simulator(diagram), len(reference.tension)
    context, found = simulator.get_context(), np.empty((2, frames, len(axes.joints)))
    ports = [diagram.GetOutputPort(f"estimator.{name}") for name in ("angle_est", "angle_std")]
    for frame in range(frames):
        simulator.AdvanceTo(robot.machine.frame * (frame + 1))
        for i, port in enumerate(ports):
            found[i, frame] = np.asarray(port.Eval(context))
    rows = drake.logged(robot.machine, diagram, context)
    signals = {name: rows[:, at] for name, at in offsets(robot.machine).items()}
    log = log_of(Recording(robot, reference, robot.machine.frame * np.arange(frames), signals))
    for kind, values in zip(("angle_est", "angle_std"), found):
        log = log.with_array(kind, axes.joints, values)
    return log
