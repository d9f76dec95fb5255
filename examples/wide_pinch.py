"""Wide pinch: flexor against extensor bends the PIP alone, if the DIP is stiff enough to stay.

The nominal DIP has no stiffness left at 8.1 N of AF, so its wide pinch is slight; `exo_index/wide_pinch` has a stiffer
DIP and a softer PIP. Both wires are pulled together along a ramp; the references are an input port of the Diagram.

Run: python examples/wide_pinch.py [--meshcat]
"""

import sys

import numpy as np
from pydrake.geometry import StartMeshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

import exodrake as exo

for name in ("exo_index", "exo_index/wide_pinch"):
    robot = exo.load_robot(name)
    tendons, joints = robot.machine.axes
    pinch = np.array([robot.grasps["wide-pinch"][tendon] for tendon in tendons])  # [N]

    builder = DiagramBuilder()
    parts = exo.add_exo_index(builder, robot)
    builder.ExportInput(parts.controller.GetInputPort("tension_ref"), "tension_ref")  # as a slider would have it
    if "--meshcat" in sys.argv:
        view = builder.AddSystem(exo.FingerView(robot, StartMeshcat()))
        builder.Connect(parts.finger.GetOutputPort("angle"), view.GetInputPort("angle"))
        builder.Connect(parts.finger.GetOutputPort("tension"), view.GetInputPort("tension"))
    diagram = builder.Build()

    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    for share in np.linspace(0.05, 1.0, 20):  # a ramp of two seconds
        diagram.GetInputPort("tension_ref").FixValue(context, np.maximum(share * pinch, 0.3))
        simulator.AdvanceTo(context.get_time() + 0.1)
    simulator.AdvanceTo(7.0)
    bend = parts.finger.GetOutputPort("angle").Eval(parts.finger.GetMyContextFromRoot(context))
    bend = bend - robot.channels("finger.q0")
    moved = ", ".join(f"{joint} {value:+.2f}" for joint, value in zip(joints, bend))
    print(f"{name}: {pinch.round(2)} N on {', '.join(tendons)} bend {moved} rad from rest")
