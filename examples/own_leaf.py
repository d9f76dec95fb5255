"""A Drake system of one's own in the loop: a limiter that lets go of the tendons when the DIP joint bends too far.

Run: python examples/own_leaf.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

import exodrake as exo
from exodrake.data.plot import save_png


class Limiter(LeafSystem):
    """Passes tension references [N] on; each frame with the DIP beyond `limit` [rad] lowers them by 3 % for good.

    Ports are joined by their names: this one reads what motion capture shows, and drives the tension controller.
    """

    def __init__(self, wanted, limit):
        super().__init__()
        self.set_name("limiter")
        self.wanted, self.limit = wanted, limit
        self.DeclareVectorInputPort("angle_read", 3)
        self.DeclareDiscreteState([1.0])  # share of the references that passes
        self.DeclareVectorOutputPort("tension_ref", 3, self.limited, {self.time_ticket(), self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(0.02, 0.0015, self.watch)  # after motion capture in slot 0

    def watch(self, context, discrete):
        if self.get_input_port().Eval(context)[2] > self.limit:
            discrete.get_mutable_vector()[0] *= 0.97

    def limited(self, context, output):
        wanted = self.wanted[min(int(context.get_time() / 0.02), len(self.wanted) - 1)]
        output.SetFromVector(np.maximum(context.get_discrete_state_vector()[0] * wanted, 0.3))


def run(robot, wanted, limit):
    diagram = exo.build_diagram(robot, seed=None, systems=[Limiter(wanted, limit)])
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.02 * len(wanted))
    return exo.diagram_log(diagram, simulator.get_context())


robot, reference = exo.load_robot(), exo.grasp("caging", hold=4.0)
free, limited = (run(robot, reference.values, limit) for limit in (10.0, 0.8))
print(f"largest DIP angle: {free['angle_DIP'].max():.2f} rad, with the limiter {limited['angle_DIP'].max():.2f} rad")
save_png(limited.plot("Limiter on the DIP", free, ("limiter", "free")), Path(*sys.argv[1:2]) / "own_leaf.png")
