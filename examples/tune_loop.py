"""Choose the gains of the tension loop: the fastest with a gain margin of 2 and a delay margin of 40 ms on every wire.

    python tune_loop.py [folder]

Searches kp and kd on the linear model of one 20 ms frame, and draws the loop found.
"""

import sys
from pathlib import Path

import exodrake as exo
from exodrake.analysis.figures import figures_of
from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.linear import linearise
from exodrake.analysis.margins import margins
from exodrake.analysis.operating import operating_point

GAIN_MARGIN, DELAY_MARGIN = 2.0, 0.04  # -, s


def acceptable(model, wires):
    """Whether every wire's loop keeps its margins."""
    found = [margins(model, wire) for wire in wires]
    return all(m.gain_margin >= GAIN_MARGIN and m.delay_margin >= DELAY_MARGIN for m in found)


def tune(robot):
    """(spectral radius, kp, kd) of the fastest acceptable pair on a coarse grid."""
    loop = FrameMap.of(robot)
    point = operating_point(loop)  # rest does not depend on the gains
    best = (1.0, robot["controller.kp"], robot["controller.kd"])
    for kp in (4e-3, 6e-3, 8e-3, 10e-3):
        for kd in (0.0, 0.5e-4, 1e-4, 1.5e-4):
            trial = loop.with_values({"controller.kp": kp, "controller.kd": kd})
            model = linearise(trial, point.state, point.references)
            if model.spectral_radius < best[0] and acceptable(model, robot.machine.axes.tendons):
                best = (model.spectral_radius, kp, kd)
    return best


folder = Path(sys.argv[1] if len(sys.argv) > 1 else "tuned")
folder.mkdir(parents=True, exist_ok=True)
robot = exo.load_robot()
radius, kp, kd = tune(robot)
tuned = exo.analyse(robot.with_parameters({"controller.kp": kp, "controller.kd": kd}))
print(f"kp {1e3 * kp:g} mm/(s N), kd {1e3 * kd:g} mm/N: spectral radius {radius:.4f}")
for step, margin in zip(tuned.steps, tuned.margins):
    print(f"{step.channel}: settles in {step.settling:.2f} s, gain margin {margin.gain_margin:.2f}")
for name, png in figures_of(tuned).items():
    (folder / name).write_bytes(png)
