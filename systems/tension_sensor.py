"""The load cells: `builder.AddSystem(TensionSensor(robot))`; their equations are in `exodrake/physics/sensor.py`."""

from functools import partial

from pydrake.systems.framework import Context, DiscreteValues

from exodrake.model.robot import Robot
from exodrake.systems.part import PartSystem

SLOTS = (1, 2, 3)  # of the frame: the bus reads one cell in each


class TensionSensor(PartSystem):
    """Load cell of each tendon: its amplifier ticks with the plant, the bus reads the cells in slots 1, 2 and 3.

    .. pydrake_system::

        name: TensionSensor
        input_ports: [deviation, tension, wire_speed, noise_tension]
        output_ports: [cell, tension_read]

    Per tendon: tension [N], wire_speed [m/s] and noise_tension, standard normal, come in; without noise 0.
    cell [N], behind the amplifier, answers the tension at once (direct feedthrough); tension_read [N] is state. State:
    cells, loads, readings [N], clock, length of the last tick [s], sliding of the tendons on the pulleys, effects.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> sensor = exo.TensionSensor()
        >>> simulator = Simulator(sensor)
        >>> _ = sensor.GetInputPort("tension").FixValue(simulator.get_mutable_context(), [5.0, 3.0, 1.0])
        >>> _ = sensor.GetInputPort("wire_speed").FixValue(simulator.get_mutable_context(), [0.0, 0.0, 0.0])
        >>> _ = simulator.AdvanceTo(0.5)
        >>> print(sensor.GetOutputPort("tension_read").Eval(simulator.get_context()).round(3))
        [5. 3. 1.]
    """

    def __init__(self, robot: Robot | None = None, substeps: int = 1) -> None:
        """Takes the robot, the nominal one if None, and plant ticks per slot."""
        super().__init__(robot, "sensor")
        self.dt = self.machine.slot / substeps
        self.tension = self.DeclareVectorInputPort("tension", 3)
        self.wire_speed = self.DeclareVectorInputPort("wire_speed", 3)
        self.DeclareVectorInputPort("noise_tension", 3)
        self.declare_outputs("cell", "tension_read")
        for period, offset in self.ticks(substeps):
            self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self.update)
        for channel, slot in enumerate(SLOTS):
            self.DeclarePeriodicDiscreteUpdateEvent(self.machine.frame, self.moment(slot), partial(self.read, channel))

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """One tick of the amplifiers."""
        tension, speed = self.tension.Eval(context), self.wire_speed.Eval(context)
        self.equations.update(discrete.get_mutable_value(0), self.p(context), self.dt, tension, speed)

    def read(self, channel: int, context: Context, discrete: DiscreteValues) -> None:
        """The bus reads one cell, with noise and rounding."""
        cell, noise = self.signal(context, "cell"), self.signal(context, "noise_tension")
        self.equations.read(discrete.get_mutable_value(0), self.p(context), channel, cell, noise)
