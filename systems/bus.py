"""The motor bus: `builder.AddSystem(Bus(robot))`; its equations are in `exodrake/physics/bus.py`."""

from functools import partial

from pydrake.systems.framework import Context, DiscreteValues

from exodrake.model.robot import Robot
from exodrake.systems.part import PartSystem

SLOTS = (5, 6, 7)  # of the frame: one drive in each


class Bus(PartSystem):
    """Motor bus: hands each speed command to its drive, in slots 5, 6 and 7 of a frame, where it is held.

    .. pydrake_system::

        name: Bus
        input_ports: [deviation, speed_cmd, packet_arrival]
        output_ports: [speed_applied]

    Per tendon: speed_cmd [m/s] and packet_arrival, uniform in 0 .. 1, come in; unconnected, every packet arrives.
    speed_applied [m/s] is state. State: the last twelve commands of each tendon and the one applied [m/s], memories of
    effects. Parameters are those of the effects `timing.*`. No direct feedthrough.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> bus = exo.Bus()
        >>> simulator = Simulator(bus)
        >>> _ = bus.GetInputPort("speed_cmd").FixValue(simulator.get_mutable_context(), [0.02, 0.0, -0.02])
        >>> _ = simulator.AdvanceTo(0.02)
        >>> print(bus.GetOutputPort("speed_applied").Eval(simulator.get_context()).round(3))
        [ 0.02  0.   -0.02]
    """

    def __init__(self, robot: Robot | None = None) -> None:
        super().__init__(robot, "bus")
        self.speed_cmd = self.DeclareVectorInputPort("speed_cmd", 3)
        self.DeclareVectorInputPort("packet_arrival", 3)
        self.declare_outputs("speed_applied")
        for channel, slot in enumerate(SLOTS):
            write = partial(self.update, channel)
            self.DeclarePeriodicDiscreteUpdateEvent(self.machine.frame, self.moment(slot), write)

    def update(self, channel: int, context: Context, discrete: DiscreteValues) -> None:
        """The bus writes to one drive."""
        command, arrival = self.speed_cmd.Eval(context), self.signal(context, "packet_arrival")
        self.equations.write(discrete.get_mutable_value(0), self.p(context), channel, command, arrival)
