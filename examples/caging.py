"""Caging grasp in a Diagram of one's own: add_exo_index, Drake's Connect, Simulator and logs; Meshcat with --meshcat.

Run: python examples/caging.py [--meshcat]
"""

import sys

from pydrake.geometry import StartMeshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

import exodrake as exo

robot = exo.load_robot()
frame, reference = robot.machine.frame, exo.grasp("caging", robot)  # 20 ms; tensions [N], a row each frame

builder = DiagramBuilder()
planner = builder.AddSystem(exo.Playback({"tension_ref": reference.values}, frame))
parts = exo.add_exo_index(builder, robot)
noise = builder.AddSystem(exo.Noise(robot.machine, seed=1))
builder.Connect(planner.GetOutputPort("tension_ref"), parts.controller.GetInputPort("tension_ref"))
builder.Connect(noise.GetOutputPort("noise_tension"), parts.sensor.GetInputPort("noise_tension"))
builder.Connect(noise.GetOutputPort("noise_angle"), parts.mocap.GetInputPort("noise_angle"))
builder.Connect(noise.GetOutputPort("packet_arrival"), parts.bus.GetInputPort("packet_arrival"))
angles = LogVectorOutput(parts.mocap.GetOutputPort("angle_read"), builder, frame)
tensions = LogVectorOutput(parts.sensor.GetOutputPort("tension_read"), builder, frame)
if "--meshcat" in sys.argv:
    view = builder.AddSystem(exo.FingerView(robot, StartMeshcat()))
    builder.Connect(parts.finger.GetOutputPort("angle"), view.GetInputPort("angle"))
    builder.Connect(parts.finger.GetOutputPort("tension"), view.GetInputPort("tension"))

simulator = Simulator(builder.Build())
simulator.set_target_realtime_rate(1.0 if "--meshcat" in sys.argv else 0.0)
simulator.AdvanceTo(frame * len(reference.values))

hold = slice(151, 196)  # samples near the end of the hold, 20 ms apart
tendons, joints = robot.machine.axes
for name, log, channels in (("angle [rad]", angles, joints), ("tension [N]", tensions, tendons)):
    held = log.FindLog(simulator.get_context()).data()[:, hold].mean(axis=1)
    print(f"{name:12s}", "  ".join(f"{channel} {value:6.3f}" for channel, value in zip(channels, held)))
