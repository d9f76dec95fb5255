"""A Drake system of one's own in the loop: a limiter that lets go of the tendons when the DIP joint bends too far."""

import sys
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

import exodrake as exo
from exodrake.data.plot import save_png

TENDONS, JOINTS = ("AF", "MF", "AE"), ("MCP", "PIP", "DIP")


class Limiter(LeafSystem):
    """Passes tension references [N] on; each frame with the DIP beyond `limit` [rad] lowers them by 3 % for good."""

    def __init__(self, wanted, limit):
        super().__init__()
        self.wanted, self.limit = wanted, limit
        self.DeclareVectorInputPort("angle", 3)
        self.DeclareDiscreteState([1.0])  # share of the references that passes
        self.DeclareVectorOutputPort("tension_ref", 3, self.limited, {self.time_ticket(), self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(0.02, 0.0015, self.watch)  # after motion capture in slot 0

    def watch(self, context, discrete):
        if self.get_input_port().Eval(context)[2] > self.limit:
            discrete.get_mutable_vector()[0] *= 0.97

    def limited(self, context, output):
        wanted = self.wanted[int(context.get_time() / 0.02)]
        output.SetFromVector(np.maximum(context.get_discrete_state_vector()[0] * wanted, 0.3))


def run(robot, wanted, limit):
    builder = DiagramBuilder()
    plant, limiter = builder.AddSystem(exo.build_diagram(robot)), builder.AddSystem(Limiter(wanted, limit))
    builder.Connect(plant.GetOutputPort("mocap.angle_read"), limiter.get_input_port())
    builder.Connect(limiter.get_output_port(), plant.GetInputPort("tension_ref"))
    for name, value in {"noise_tension": 0.0, "noise_angle": 0.0, "packet_arrival": 1.0}.items():  # 1: none is lost
        builder.Connect(
            builder.AddSystem(ConstantVectorSource([value] * 3)).get_output_port(), plant.GetInputPort(name)
        )
    ports = {"tension_ref": limiter.get_output_port()}
    ports |= {"tension": plant.GetOutputPort("sensor.tension_read"), "angle": plant.GetOutputPort("mocap.angle_read")}
    sinks = {kind: LogVectorOutput(port, builder, 0.02) for kind, port in ports.items()}
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.02 * (len(wanted) - 1))
    rows = {kind: sink.FindLog(simulator.get_context()).data().T for kind, sink in sinks.items()}
    log = exo.Log(0.02 * np.arange(len(wanted)), {}).with_array("angle", JOINTS, rows["angle"])
    return log.with_array("tension", TENDONS, rows["tension"]).with_array("tension_ref", TENDONS, rows["tension_ref"])


robot, reference = exo.load_robot(), exo.grasp("caging", hold=4.0)
free, limited = (run(robot, reference.tension, limit) for limit in (10.0, 0.8))
print(f"largest DIP angle: {free['angle_DIP'].max():.2f} rad, with the limiter {limited['angle_DIP'].max():.2f} rad")
save_png(limited.plot("Limiter on the DIP", free, ("limiter", "free")), Path(*sys.argv[1:2]) / "own_leaf.png")
