"""The encoders: `builder.AddSystem(Encoder(robot))`; their equations are in `exodrake/physics/encoder.py`."""

from functools import partial

from pydrake.systems.framework import Context, DiscreteValues

from exodrake.model.robot import Robot
from exodrake.systems.part import PartSystem

SLOTS = (1, 2, 3)  # of the frame: the bus reads one encoder in each


class Encoder(PartSystem):
    """Encoder of each tendon's spool, read over the bus in slots 1, 2 and 3 of a frame and rounded to its resolution.

    .. pydrake_system::

        name: Encoder
        input_ports: [deviation, spool_angle, start_stroke]
        output_ports: [stroke_read]

    Per tendon: spool_angle [rad] comes in, and start_stroke [m], which is shown until the first reading.
    stroke_read [m] is state. State: readings [m], then memories of effects. No direct feedthrough.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> encoder = exo.Encoder()
        >>> simulator = Simulator(encoder)
        >>> _ = encoder.GetInputPort("spool_angle").FixValue(simulator.get_mutable_context(), [1.0, 0.5, 0.0])
        >>> _ = simulator.AdvanceTo(0.02)
        >>> print(encoder.GetOutputPort("stroke_read").Eval(simulator.get_context()).round(3))
        [0.008 0.004 0.   ]
    """

    def __init__(self, robot: Robot | None = None) -> None:
        super().__init__(robot, "encoder")
        self.spool_angle = self.DeclareVectorInputPort("spool_angle", 3)
        self.DeclareVectorInputPort("start_stroke", 3)
        self.declare_outputs("stroke_read")
        for channel, slot in enumerate(SLOTS):
            read = partial(self.update, channel)
            self.DeclarePeriodicDiscreteUpdateEvent(self.machine.frame, self.moment(slot), read)

    def update(self, channel: int, context: Context, discrete: DiscreteValues) -> None:
        """The bus reads one encoder."""
        angle = self.spool_angle.Eval(context)
        self.equations.read(discrete.get_mutable_value(0), self.p(context), channel, angle)
