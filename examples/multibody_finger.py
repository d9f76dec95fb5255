"""The plant replaced by a finger of Drake's MultibodyPlant under the same tendons; the rest of the robot stays.

Run: python examples/multibody_finger.py
"""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

import exodrake as exo

robot, reference = exo.load_robot(), exo.grasp("caging", hold=1.0)
frame = robot.machine.frame


def angles(**own):
    """Joint angles (frames, 3) [rad] of the grasp, with systems of one's own in the place of parts."""
    builder = DiagramBuilder()
    parts = exo.add_exo_index(builder, robot, **own)
    planner = builder.AddSystem(exo.Playback({"tension_ref": reference.values}, frame))
    builder.Connect(planner.GetOutputPort("tension_ref"), parts.controller.GetInputPort("tension_ref"))
    log = LogVectorOutput(parts.finger.GetOutputPort("angle"), builder, frame)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(2.0)
    return log.FindLog(simulator.get_context()).data().T


ours, theirs = angles(), angles(finger=exo.MultibodyFinger(robot))
for joint, a, b in zip(robot.machine.axes.joints, ours.T, theirs.T):
    apart = 1e3 * np.sqrt(((a - b) ** 2).mean())
    print(f"{joint}: {a[-1]:.3f} rad, MultibodyPlant {b[-1]:.3f}; RMS difference {apart:.2f} mrad")
