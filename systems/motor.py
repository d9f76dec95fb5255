"""The motors: `builder.AddSystem(MotorDynamics(robot))`; their equations are in `exodrake/physics/motor.py`."""

from pydrake.systems.framework import Context, DiscreteValues

from exodrake.model.robot import Robot
from exodrake.systems.part import PartSystem


class MotorDynamics(PartSystem):
    """Rotor, gear and spool of each tendon behind a current-limited PI speed loop; ticks with the plant, every 2 ms.

    .. pydrake_system::

        name: MotorDynamics
        input_ports: [deviation, speed_applied, tension_spool, start_stroke]
        output_ports: [stroke, wire_speed, spool_angle]

    Per tendon: speed_applied [m/s], tension_spool [N] and start_stroke [m], where the tendon is just taut, come in;
    stroke [m], wire_speed [m/s] and spool_angle [rad] are functions of the state. State: rotor speeds [rad/s], integral
    parts of the speed loops [A], spool angles [rad], then memories of effects. No direct feedthrough.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> motor = exo.MotorDynamics()
        >>> simulator = Simulator(motor)
        >>> _ = motor.GetInputPort("speed_applied").FixValue(simulator.get_mutable_context(), [0.02, 0.01, -0.02])
        >>> _ = motor.GetInputPort("tension_spool").FixValue(simulator.get_mutable_context(), [5.0, 3.0, 1.0])
        >>> _ = simulator.AdvanceTo(1.0)
        >>> print(motor.GetOutputPort("wire_speed").Eval(simulator.get_context()).round(3))
        [ 0.02  0.01 -0.02]
    """

    def __init__(self, robot: Robot | None = None, substeps: int = 1) -> None:
        """Takes the robot, the nominal one if None, and plant ticks per slot."""
        super().__init__(robot, "motor")
        self.dt = self.machine.slot / substeps
        self.speed_applied = self.DeclareVectorInputPort("speed_applied", 3)
        self.tension_spool = self.DeclareVectorInputPort("tension_spool", 3)
        self.DeclareVectorInputPort("start_stroke", 3)
        self.declare_outputs("stroke", "wire_speed", "spool_angle")
        for period, offset in self.ticks(substeps):
            self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """One tick of the equations of motion, with commands and tensions held."""
        speed, tension = self.speed_applied.Eval(context), self.tension_spool.Eval(context)
        self.equations.update(discrete.get_mutable_value(0), self.p(context), self.dt, speed, tension)
