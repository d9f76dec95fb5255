"""The finger under its tendons: `TendonFinger(robot)`; its equations are in `exodrake/physics/tendon_finger.py`."""

from functools import partial

from pydrake.systems.framework import Context, DiscreteValues

from exodrake.model.robot import Robot
from exodrake.systems.part import PartSystem


class TendonFinger(PartSystem):
    """Three elastic tendons on a planar finger of three joints; ticks with the plant, every 2 ms.

    .. pydrake_system::

        name: TendonFinger
        input_ports: [deviation, stroke, wire_speed]
        output_ports: [angle, rate, tension_finger, tension, tension_spool, start_stroke]

    stroke [m] and wire_speed [m/s] per tendon come in. angle [rad] and rate [rad/s] per joint, and tension_finger [N],
    behind the friction of the tendons, are state. tension [N] at the load cell and tension_spool [N] answer the stroke
    at once (direct feedthrough). start_stroke [m], from the parameters alone: the tendons are just taut in the rest
    posture. State: angles, rates, both of the tick before, tendon paths [m], presliding, tensions, clock [s], effects.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> finger = exo.TendonFinger()
        >>> simulator = Simulator(finger)
        >>> _ = finger.GetInputPort("stroke").FixValue(simulator.get_mutable_context(), [0.008, 0.002, 0.0])
        >>> _ = finger.GetInputPort("wire_speed").FixValue(simulator.get_mutable_context(), [0.0, 0.0, 0.0])
        >>> _ = simulator.AdvanceTo(1.0)
        >>> print(finger.GetOutputPort("angle").Eval(simulator.get_context()).round(3))
        [ 0.371  0.722 -0.164]
    """

    def __init__(self, robot: Robot | None = None, substeps: int = 1) -> None:
        """Takes the robot, the nominal one if None, and plant ticks per slot."""
        super().__init__(robot, "finger")
        self.dt = self.machine.slot / substeps
        self.stroke = self.DeclareVectorInputPort("stroke", 3)
        self.wire_speed = self.DeclareVectorInputPort("wire_speed", 3)
        self.declare_outputs("angle", "rate", "tension_finger", "tension", "tension_spool")
        self.DeclareVectorOutputPort("start_stroke", 3, partial(self.show_start, 0), {self.parameters_ticket})
        for period, offset in self.ticks(substeps):
            self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """One tick of the equations of motion; the spools move on at their speed."""
        stroke, speed = self.stroke.Eval(context), self.wire_speed.Eval(context)
        self.equations.update(discrete.get_mutable_value(0), self.p(context), self.dt, stroke, speed)
