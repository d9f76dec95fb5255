"""The joint-angle estimator: `GPEstimator(weights)`; its equations are in `exodrake/physics/gp_estimator.py`."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from exodrake.machines.robot_file import robot_or_default
from exodrake.model.machine import Machine
from exodrake.physics.gp_estimator import Weights, predict_into, scratch
from exodrake.systems.part import Cloneable, NamedParameter, array_parameter

LISTENS = 8  # slot of the frame: after the bus


class GPEstimator(Cloneable, LeafSystem):
    """Joint angles and their standard deviations from tension and stroke as read, once a frame in slot 8.

    .. pydrake_system::

        name: GPEstimator
        input_ports: [tension_read, stroke_read]
        output_ports: [angle_est, angle_std]

    Tension [N] and stroke [m] per tendon; both outputs [rad] per joint, state, and NaN before the first estimate. The
    weights of the trained estimator are numeric parameters, one for each field of `Weights`, found by `parameter`.
    `exodrake estimate --as-trained` adds the same columns to the log of a run, to the last bit.

    Args:
        weights: of the trained estimator.
        machine: whose frame it keeps; None: that of the Exo-Index.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> from exodrake.estimator.gp import quick_estimator
        >>> estimator = exo.GPEstimator(quick_estimator(exo.load_robot()).weights)
        >>> simulator = Simulator(estimator)
        >>> _ = estimator.GetInputPort("tension_read").FixValue(simulator.get_mutable_context(), [5.0, 3.0, 1.0])
        >>> _ = estimator.GetInputPort("stroke_read").FixValue(simulator.get_mutable_context(), [0.008, 0.002, 0.0])
        >>> _ = simulator.AdvanceTo(0.02)
        >>> print(estimator.GetOutputPort("angle_est").Eval(simulator.get_context()).round(3))
        [0.202 0.285 0.228]
    """

    def __init__(self, weights: Weights, machine: Machine | None = None) -> None:
        super().__init__()
        self.set_name("estimator")
        machine = machine or robot_or_default(None).machine
        self.shapes = {name: values.shape for name, values in weights._asdict().items()}
        for values in weights:
            self.DeclareNumericParameter(BasicVector(np.ravel(values)))
        tendons, unknown = len(weights.center) // 2, np.full(len(weights.offset), np.nan)
        self.tension_read = self.DeclareVectorInputPort("tension_read", tendons)
        self.stroke_read = self.DeclareVectorInputPort("stroke_read", tendons)
        for name in ("angle_est", "angle_std"):
            self.DeclareStateOutputPort(name, DiscreteStateIndex(int(self.DeclareDiscreteState(unknown))))
        self.DeclarePeriodicDiscreteUpdateEvent(machine.frame, (LISTENS + 0.5) * machine.slot, self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """One estimate."""
        flat = (np.array(context.get_numeric_parameter(i).value()) for i in range(len(self.shapes)))
        weights = Weights(*(values.reshape(shape) for values, shape in zip(flat, self.shapes.values())))
        mean, std = discrete.get_mutable_value(0), discrete.get_mutable_value(1)
        tension, stroke = self.tension_read.Eval(context), self.stroke_read.Eval(context)
        predict_into(tension, stroke, weights, scratch(weights), mean, std)

    def parameter(self, name: str) -> NamedParameter:
        """A field of the weights, flat. InputError for another name."""
        return array_parameter(self, name, {key: int(np.prod(shape)) for key, shape in self.shapes.items()})
