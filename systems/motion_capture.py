"""Motion capture: `builder.AddSystem(MotionCapture(robot))`; its equations are in `exodrake/physics/mocap.py`."""

from pydrake.systems.framework import Context, DiscreteValues

from exodrake.model.robot import Robot
from exodrake.systems.part import PartSystem

SLOT = 0  # of the frame


class MotionCapture(PartSystem):
    """Joint angles by motion capture, with white noise, in slot 0 of each frame.

    .. pydrake_system::

        name: MotionCapture
        input_ports: [deviation, angle, noise_angle]
        output_ports: [angle_read, mocap_delay]

    Per joint: angle [rad] and noise_angle, standard normal, come in; unconnected noise counts as 0. angle_read [rad],
    mocap_delay [s], by how much the picture is late (`exo.diagram_log` delays it), are state. State: readings [rad],
    delay [s], number of pictures, effects. No direct feedthrough.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> mocap = exo.MotionCapture()
        >>> simulator = Simulator(mocap)
        >>> _ = mocap.GetInputPort("angle").FixValue(simulator.get_mutable_context(), [0.2, 0.4, 0.1])
        >>> _ = simulator.AdvanceTo(0.02)
        >>> print(mocap.GetOutputPort("angle_read").Eval(simulator.get_context()).round(3))
        [0.2 0.4 0.1]
    """

    def __init__(self, robot: Robot | None = None) -> None:
        super().__init__(robot, "mocap")
        self.angle = self.DeclareVectorInputPort("angle", 3)
        self.DeclareVectorInputPort("noise_angle", 3)
        self.declare_outputs("angle_read", "mocap_delay")
        self.DeclarePeriodicDiscreteUpdateEvent(self.machine.frame, self.moment(SLOT), self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """One picture of all joints."""
        angle, noise = self.angle.Eval(context), self.signal(context, "noise_angle")
        self.equations.sample(discrete.get_mutable_value(0), self.p(context), angle, noise)
