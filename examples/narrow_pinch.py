"""Narrow pinch through Drake's own sources: a ramp by TrajectorySource, and the compiled simulator's log beside it.

Run: python examples/narrow_pinch.py [--meshcat]
"""

import sys

import numpy as np
from pydrake.geometry import StartMeshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

import exodrake as exo

robot = exo.load_robot()
tendons, joints = robot.machine.axes
rest = np.array([robot.limits["F_min"][tendon] for tendon in tendons])  # [N]
pinch = np.array([robot.grasps["narrow-pinch"][tendon] for tendon in tendons])
ramp = PiecewisePolynomial.CubicShapePreserving([0.0, 0.5, 1.5, 4.0], np.array([rest, rest, pinch, pinch]).T)

builder = DiagramBuilder()
planner = builder.AddSystem(TrajectorySource(ramp))
parts = exo.add_exo_index(builder, robot)
builder.Connect(planner.get_output_port(), parts.controller.GetInputPort("tension_ref"))
log = LogVectorOutput(parts.finger.GetOutputPort("angle"), builder, 0.02)
if "--meshcat" in sys.argv:
    view = builder.AddSystem(exo.FingerView(robot, StartMeshcat()))
    builder.Connect(parts.finger.GetOutputPort("angle"), view.GetInputPort("angle"))
    builder.Connect(parts.finger.GetOutputPort("tension"), view.GetInputPort("tension"))
simulator = Simulator(builder.Build())
simulator.AdvanceTo(4.0)
angle = log.FindLog(simulator.get_context()).data()[:, 1:].T

# the controller samples its reference in the middle of slot 4, 9 ms into a frame
sampled = exo.Reference(np.hstack([ramp.value(0.009 + 0.02 * k) for k in range(200)]).T)
compiled = exo.record(robot, sampled, seed=None).signals["angle"]
print("the pinch:", ", ".join(f"{joint} {value:.2f} rad" for joint, value in zip(joints, angle[-1])))
print("the compiled simulator gives the same to the last bit:", np.array_equal(angle, compiled))
