"""A plan in the Diagram, with the joint-angle estimator listening in slot 8."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import offsets
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.estimator.gp import Estimator
from exodrake.grasping.plan import Plan
from exodrake.grasping.trial import nominal
from exodrake.simulation.simulate import Recording, log_of, simulate

POINTS = 250  # of the quick estimator: seconds of training


def run_plan(plan: Plan, robot: Robot, estimator: Estimator, seed: int | None = 0) -> Log:
    """The log of a robot in the Drake Diagram that follows a plan, with `angle_est` and `angle_std` of the estimator.

    InputError for an estimator of other wires or joints.
    """
    from exodrake.diagrams import diagram as drake

    axes, reference = robot.machine.axes, plan.reference(robot)
    if (estimator.wires, estimator.joints) != (axes.tendons, axes.joints):
        raise InputError(f"estimator of wires {', '.join(estimator.wires)}, joints {', '.join(estimator.joints)}")
    diagram = drake.build_diagram(robot, reference, seed, estimator=estimator.weights)
    simulator, frames = drake.Simulator(diagram), len(reference.tension)
    context, found = simulator.get_context(), np.empty((2, frames, len(axes.joints)))
    ports = [diagram.GetOutputPort(f"estimator.{wire}") for wire in ("angle_est", "angle_std")]
    for frame in range(frames):
        simulator.AdvanceTo(robot.machine.frame * (frame + 1))
        for i, port in enumerate(ports):
            found[i, frame] = np.asarray(port.Eval(context))
    rows = drake.logged(robot.machine, diagram, context)
    wires = {name: rows[:, at] for name, at in offsets(robot.machine).items()}
    log = log_of(Recording(robot, reference, robot.machine.frame * np.arange(frames), wires))
    for kind, rows in zip(("angle_est", "angle_std"), found):
        log = log.with_array(kind, axes.joints, rows)
    return log


def mark(robot: Robot) -> str:
    """Signature of a robot's numbers: an estimator trained on others is not its own."""
    return sha256(np.ascontiguousarray(robot.values).tobytes()).hexdigest()


def quick_estimator(robot: Robot, cache: Path | None = None) -> Estimator:
    """An estimator trained on simulated sweeps of the nominal robot, in seconds, or the one kept in `cache`.

    A kept one of other numbers, or a file that is none, is trained anew; nothing is written.
    """
    from exodrake.estimator.dataset import sweeps_from_logs
    from exodrake.estimator.file import load
    from exodrake.estimator.gp import fit
    from exodrake.simulation.protocols import sweeps

    plain = nominal(robot)
    if cache is not None and cache.is_file():
        try:
            return load(cache, mark(plain))
        except InputError:
            pass
    training = sweeps_from_logs([simulate(plain, sweeps(plain), seed=0)])
    return replace(fit(training, POINTS), robot=mark(plain))
