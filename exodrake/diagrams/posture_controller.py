"""The posture controller as a Drake system; its law is `physics.posture_controller`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues

from exodrake.core.machine import Machine
from exodrake.diagrams.frame_leaf import FrameLeaf
from exodrake.physics.posture_controller import corrected

SLOT = 3  # before the tension controller's slot
PARAMETERS = ("ki", "gain", "low", "high")


@dataclass(frozen=True, eq=False)
class PosturePlan:
    """Plan of a posture controller: tensions, angles, gains and limits.

    Attributes:
        tension: (frames, tendons) array, planned tensions [N]; the last row stays.
        angle: (frames, joints) array, the angles that the nominal robot then takes [rad].
        gain: (tendons, joints) array [N/rad].
        low, high: (tendons,) arrays, limits of the tension references [N].
        ki: [1/s]; 0 leaves the planned tensions as they are.
    """

    tension: np.ndarray
    angle: np.ndarray
    gain: np.ndarray
    low: np.ndarray
    high: np.ndarray
    ki: float


class PostureController(FrameLeaf):
    """Tension references for a posture from the estimated angles, once a frame in slot 3.

    .. pydrake_system::

        name: PostureController
        input_ports:
        - angle_est
        output_ports:
        - tension_ref
        - angle_ref

    angle_est [rad] per joint, from an estimator of slot 8 of the frame before; tension_ref [N] per tendon and angle_ref
    [rad] are state. `parameter("ki")`, `gain`, `low`, `high` are numeric parameters.
    """

    def __init__(self, plan: PosturePlan, machine: Machine) -> None:
        parameters = {name: np.asarray(getattr(plan, name)) for name in PARAMETERS}
        outputs = {"tension_ref": plan.tension[0], "angle_ref": plan.angle[0]}
        super().__init__("posture", machine, SLOT, parameters, {"angle_est": plan.angle.shape[1]}, outputs)
        self.DeclareDiscreteState(np.zeros(plan.tension.shape[1]))
        self.plan, self.frame = plan, machine.frame

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """The event."""
        ki, gain, low, high = (np.array(context.get_numeric_parameter(i).value()) for i in range(len(PARAMETERS)))
        frame = min(int(context.get_time() / self.frame), len(self.plan.tension) - 1)
        error = self.plan.angle[frame] - self.EvalVectorInput(context, 0).value()
        before = np.array(context.get_discrete_state(2).value())
        step, gain = ki[0] * self.frame, gain.reshape(self.plan.gain.shape)
        tension, correction = corrected(before, self.plan.tension[frame], error, gain, step, low, high)
        discrete.set_value(0, tension)
        discrete.set_value(1, self.plan.angle[frame])
        discrete.set_value(2, correction)
