"""A controller of one's own in place of the robot's: a proportional law, beside the admittance law of the paper.

Run: python examples/own_controller.py
"""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

import exodrake as exo


class Proportional(LeafSystem):
    """Speed of the wire in proportion to the tension error, once a frame; the ports of the part that it replaces."""

    def __init__(self, gain):
        super().__init__()
        self.set_name("controller")
        self.gain = gain  # [m/(s N)]
        self.tension_ref = self.DeclareVectorInputPort("tension_ref", 3)
        self.tension_read = self.DeclareVectorInputPort("tension_read", 3)
        self.DeclareStateOutputPort("speed_cmd", self.DeclareDiscreteState(3))
        self.DeclarePeriodicDiscreteUpdateEvent(0.02, 0.009, self.update)  # slot 4: after the readings, before the bus

    def update(self, context, discrete):
        discrete.set_value(0, self.gain * (self.tension_ref.Eval(context) - self.tension_read.Eval(context)))


def settled(*systems):
    """Time [s] after which the tension of AF stays within 0.2 N of its reference."""
    diagram = exo.build_diagram(robot, reference, seed=None, systems=systems)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(4.0)
    signals = exo.logged_signals(diagram, simulator.get_context())
    return 0.02 * np.flatnonzero(np.abs(signals["tension_read"][:, 0] - 6.0) > 0.2)[-1]


robot, reference = exo.load_robot(), exo.Reference(np.tile([6.0, 1.0, 0.5], (200, 1)), "step")
print(f"the robot's controller settles after {settled():.2f} s")
for gain in (0.002, 0.004, 0.008):
    print(f"proportional, {1e3 * gain:.0f} mm/s per N: {settled(Proportional(gain)):.2f} s")
