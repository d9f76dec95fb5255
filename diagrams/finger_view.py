"""The finger in Meshcat, as recordings show it, moved by the Diagram while it runs.

meshcat = Meshcat()
diagram = build_diagram(robot, reference, systems=[FingerView(robot, meshcat)])
"""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, LeafSystem

from exodrake.core.robot import Robot
from exodrake.diagrams.meshcat import colours, full_load
from exodrake.diagrams.meshcat.scene import Finger, finger_skeleton


class FingerView(LeafSystem):
    """Finger and tendons in Meshcat, the tendons coloured by their tension as a share of its limit.

    .. pydrake_system::

        name: FingerView
        input_ports:
        - angle
        - tension

    angle [rad] per joint, tension [N] per tendon; without `tension` the tendons stay grey. Tendons are drawn straight
    between their routers.

    Raises:
        InputError: the robot has no finger.
    """

    def __init__(self, robot: Robot, meshcat: Meshcat, rate: float = 32.0) -> None:
        """Takes the robot, a Meshcat, and pictures per simulated second."""
        super().__init__()
        bones = finger_skeleton(robot)
        self.finger, self.optional = Finger(meshcat, bones), ("tension",)
        self.highest = full_load(robot, bones, np.zeros((1, len(bones.tendons))))
        self.DeclareVectorInputPort("angle", len(bones.joints))
        self.DeclareVectorInputPort("tension", len(bones.tendons))
        self.finger.begin(np.zeros(len(bones.joints)), False)
        self.DeclareForcedPublishEvent(self._draw)
        self.DeclarePeriodicPublishEvent(1.0 / rate, 0.0, self._draw)
        self.set_name("view")

    def _draw(self, context: Context) -> None:
        """Moves the finger to the present angles and colours its tendons."""
        tension = self.GetInputPort("tension")
        load = np.array(tension.Eval(context) if tension.HasValue(context) else np.zeros(len(self.highest)))
        angle = np.array(self.GetInputPort("angle").Eval(context))
        self.finger.show(context.get_time(), angle, colours(np.abs(load) / self.highest))
