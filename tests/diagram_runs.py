"""What the tests of Drake and of the parts share: references, runs by both engines."""

from functools import cache

import numpy as np

from exodrake.engine.inputs import NoiseInputs, Reference, prepare_values
from exodrake.engine.run import run_compiled
from exodrake.machines.robot_file import load_robot
from exodrake.physics.gp_estimator import Weights


@cache
def nominal():
    return load_robot()


def wavy(seconds):
    """Tension references [N] that keep all wires busy, slack now and then on the extensor."""
    time = 0.02 * np.arange(round(seconds / 0.02))[:, None]
    centre, swing, rate = np.array([5.0, 3.5, 2.0]), np.array([4.0, 3.0, 1.9]), np.array([0.4, 0.7, 1.1])
    return Reference(centre + swing * np.sin(2 * np.pi * rate * time), "wavy")


def both(robot, reference, seed=1, substeps=1, **options):
    """Rows of all wires by the compiled simulator and by the Diagram, for the same draws."""
    from exodrake.diagrams.diagram import run_diagram

    values, noise_inputs = prepare_values(robot), NoiseInputs.draw(len(reference.values), seed, robot.machine)
    compiled = run_compiled(robot.machine, values, reference, noise_inputs, substeps)
    return compiled, run_diagram(robot, values, reference, noise_inputs, substeps, **options)


def made_up_weights(points=30):
    """An estimator of random numbers: its arithmetic, not its sense, is at stake."""
    rng = np.random.default_rng(4)
    return Weights(
        center=rng.normal(size=6),
        rotation=rng.normal(size=(6, 6)),
        points=rng.normal(size=(6, points)),
        shrink=rng.uniform(0.1, 0.5, 6),
        variances=np.array([0.1, 1.0, 1e-3]),
        alpha=rng.normal(size=(points, 3)),
        factor=1e-3 * rng.normal(size=points * (points + 1) // 2),
        offset=rng.normal(size=3),
        gain=rng.normal(size=3),
        spread=rng.uniform(0.1, 1.0, 3),
    )
