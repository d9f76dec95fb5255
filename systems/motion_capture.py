"""Motion capture: `builder.AddSystem(MotionCapture(robot))`; its equations are in `exodrake/physics/mocap.py`."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from exodrake.core.robot import Robot
from exodrake.systems.part import PartSystem

SLOT = 0  # of the frame


class MotionCapture(PartSystem):
    """Joint angles by motion capture, with white noise, in slot 0 of each frame.

    .. pydrake_system::

        name: MotionCapture
        input_ports:
        - deviation
        - angle
        - noise_angle
        output_ports:
        - angle_read
        - mocap_delay

    Per joint: angle [rad] and noise_angle, standard normal, come in; unconnected noise counts as 0. angle_read [rad],
    mocap_delay [s], by how much the picture is late (`exo.diagram_log` delays it), are state. State: readings [rad],
    delay [s], number of pictures, effects. No direct feedthrough.

    Example:
        mocap = MotionCapture()
        simulator = Simulator(mocap)
        mocap.GetInputPort("angle").FixValue(simulator.get_mutable_context(), [0.2, 0.4, 0.1])
        simulator.AdvanceTo(0.02)
        print(mocap.GetOutputPort("angle_read").Eval(simulator.get_context()))
    """

    def __init__(self, robot: Robot | None = None) -> None:
        """Takes the robot, the nominal one if None."""
        super().__init__(robot, "mocap")
        self.angle = self.DeclareVectorInputPort("angle", 3)
        self.noise = self.DeclareVectorInputPort("noise_angle", 3)
        needs = {self.xd_ticket(), self.parameters_ticket}
        self.DeclareVectorOutputPort("angle_read", 3, self.show_angle, needs)
        self.DeclareVectorOutputPort("mocap_delay", 1, self.show_delay, needs)
        self.DeclarePeriodicDiscreteUpdateEvent(self.machine.frame, self.moment(SLOT), self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """One picture of all joints."""
        noise = self.noise.Eval(context) if self.noise.HasValue(context) else np.zeros(3)
        self.equations.sample(discrete.get_mutable_value(0), self.p(context), self.angle.Eval(context), noise)

    def show_angle(self, context: Context, output: BasicVector) -> None:
        """Last picture [rad]."""
        found = np.empty(3)
        self.equations.output(self.x(context), self.p(context), found)
        output.set_value(found)

    def show_delay(self, context: Context, output: BasicVector) -> None:
        """How late the last picture is [s]."""
        found = np.empty(1)
        self.equations.output_late(self.x(context), self.p(context), found)
        output.set_value(found)
