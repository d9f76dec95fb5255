"""Monte Carlo over the tolerances of the robot file: how far does a caging grasp differ from robot to robot?

Run: python examples/monte_carlo.py
"""

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import MonteCarloSimulation, Simulator

import exodrake as exo

robot = exo.load_robot()
diagram = exo.build_diagram(robot, exo.grasp("caging", robot))
kappa = exo.find_parameter(diagram, "finger.kappa.DIP")  # stiffness of a joint [N m/rad]
samples = []


def output(system, context):
    """Flexion of the DIP joint [rad]; notes all angles and the stiffness of this robot."""
    angle = system.GetOutputPort("finger.angle").Eval(context)
    samples.append([*angle, kappa.get(context)[0]])
    return angle[2]


results = MonteCarloSimulation(
    make_simulator=lambda generator: Simulator(diagram),
    output=output,
    final_time=3.0,
    num_samples=12,
    generator=RandomGenerator(1),
)
mean, std = np.mean(samples, axis=0), np.std(samples, axis=0, ddof=1)
print(f"{len(results)} robots: stiffness of the DIP joint {1e3 * mean[3]:.1f} +- {1e3 * std[3]:.1f} mN m/rad")
for i, joint in enumerate(robot.machine.axes.joints):
    print(f"{joint}: {mean[i]:.3f} +- {std[i]:.3f} rad")
