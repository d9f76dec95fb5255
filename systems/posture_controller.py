"""The posture controller, `PostureController(plan)`: planned tensions, corrected by the integral of the angle error.

    c' = k_i G (q_ref - q)        F_ref = clip(F_plan + c, F_min, F_max)        G = J^T (J J^T + (d s)^2 I)^-1

Around the paper's Fig. 4. c is the correction [N], J = dq/dF the compliance of the finger under its tendons [rad/N], s
its largest singular value, and d the damping of its inverse. c is cut so that F_plan + c stays within the limits, which
keeps it from winding up.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from exodrake.machines.robot_file import robot_or_default
from exodrake.model.machine import Machine
from exodrake.systems.part import Cloneable, NamedParameter, array_parameter

RUNS = 3  # slot of the frame: before the tension controller
PARAMETERS = ("ki", "gain", "low", "high")
DAMPING = 0.1  # assumed: directions in which a tension moves the finger less than this share of the best are spared


def damped_inverse(compliance: np.ndarray) -> np.ndarray:
    """G (tendons, joints) [N/rad] from J (joints, tendons) [rad/N]."""
    size = DAMPING * np.linalg.norm(compliance, 2)
    inner = compliance @ compliance.T + size**2 * np.eye(len(compliance))
    return np.linalg.solve(inner, compliance).T


def correct_tensions(
    correction: np.ndarray, planned: np.ndarray, error: np.ndarray, gain: np.ndarray, step: float,
    low: np.ndarray, high: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Tension references (tendons,) [N], and the correction (tendons,) [N] of the next period.

    From that of the last one; planned tensions and their limits (tendons,) [N]; wanted less estimated angles (joints,)
    [rad], NaN before the first estimate, which counts as none; gain (tendons, joints) [N/rad]; step: k_i periods [-].
    """
    wanted = planned + correction
    for i, missing in enumerate(error):
        if missing == missing:
            wanted = wanted + step * gain[:, i] * missing
    tension = np.minimum(np.maximum(wanted, low), high)
    return tension, tension - planned


@dataclass(frozen=True, eq=False)
class PosturePlan:
    """Plan of a posture controller: tensions, angles, gains and limits."""

    tension: np.ndarray  # (frames, tendons) planned [N]; the last row stays
    angle: np.ndarray  # (frames, joints) that the nominal robot then takes [rad]
    gain: np.ndarray  # (tendons, joints) [N/rad]
    low: np.ndarray  # (tendons,) limits of the tension references [N]
    high: np.ndarray
    ki: float  # [1/s]; 0 leaves the planned tensions as they are


class PostureController(Cloneable, LeafSystem):
    """Tension references for a posture from the estimated angles, once a frame in slot 3.

    .. pydrake_system::

        name: PostureController
        input_ports: [angle_est, tension_planned, angle_planned]
        output_ports: [tension_ref, angle_ref]

    angle_est [rad] per joint comes from an estimator, NaN before the first estimate. tension_planned [N] per tendon and
    angle_planned [rad] per joint are what a planner wants; unconnected, they are the rows of the plan. tension_ref [N]
    and angle_ref [rad] are state, and so is the correction [N]. `parameter("ki")`, `gain`, `low`, `high` are numeric
    parameters.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> import numpy as np
        >>> from exodrake.systems.posture_controller import PosturePlan
        >>> still = PosturePlan(np.ones((1, 3)), np.zeros((1, 3)), np.eye(3), np.full(3, 0.3), np.full(3, 8.0), ki=0.5)
        >>> posture = exo.PostureController(still)
        >>> simulator = Simulator(posture)
        >>> _ = posture.GetInputPort("angle_est").FixValue(simulator.get_mutable_context(), [-0.1, 0.0, 0.1])
        >>> _ = simulator.AdvanceTo(1.0)
        >>> print(posture.GetOutputPort("tension_ref").Eval(simulator.get_context()).round(3))
        [1.05 1.   0.95]
    """

    optional = ("tension_planned", "angle_planned")  # input ports that may stay unconnected

    def __init__(self, plan: PosturePlan, machine: Machine | None = None) -> None:
        """Takes the plan and the machine whose frame it keeps; None: that of the Exo-Index."""
        super().__init__()
        self.set_name("posture")
        machine = machine or robot_or_default(None).machine
        self.plan, self.frame = plan, machine.frame
        for name in PARAMETERS:
            self.DeclareNumericParameter(BasicVector(np.ravel(getattr(plan, name)).astype(float)))
        tendons, joints = plan.tension.shape[1], plan.angle.shape[1]
        self.angle_est = self.DeclareVectorInputPort("angle_est", joints)
        self.tension_planned = self.DeclareVectorInputPort("tension_planned", tendons)
        self.angle_planned = self.DeclareVectorInputPort("angle_planned", joints)
        for name, first in (("tension_ref", plan.tension[0]), ("angle_ref", plan.angle[0])):
            self.DeclareStateOutputPort(name, DiscreteStateIndex(int(self.DeclareDiscreteState(first))))
        self.DeclareDiscreteState(np.zeros(tendons))  # the correction
        self.DeclarePeriodicDiscreteUpdateEvent(self.frame, (RUNS + 0.5) * machine.slot, self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """One step of the law."""
        ki, gain, low, high = (np.array(context.get_numeric_parameter(i).value()) for i in range(len(PARAMETERS)))
        planned = self.read_plan(self.tension_planned, self.plan.tension, context)
        angle = self.read_plan(self.angle_planned, self.plan.angle, context)
        error, step = angle - self.angle_est.Eval(context), ki[0] * self.frame
        before, gain = context.get_discrete_state(2).value(), gain.reshape(self.plan.gain.shape)
        tension, correction = correct_tensions(before, planned, error, gain, step, low, high)
        for group, values in enumerate((tension, angle, correction)):
            discrete.set_value(group, values)

    def read_plan(self, port: Any, rows: np.ndarray, context: Context) -> np.ndarray:
        """What a planner wants now, (channels,) [N] or [rad]: at the port, else the plan's row of this frame."""
        frame = int(context.get_time() / self.frame)
        return port.Eval(context) if port.HasValue(context) else rows[min(frame, len(rows) - 1)]

    def parameter(self, name: str) -> NamedParameter:
        """All values of a parameter, flat. InputError for another name."""
        return array_parameter(self, name, {key: int(np.size(getattr(self.plan, key))) for key in PARAMETERS})
