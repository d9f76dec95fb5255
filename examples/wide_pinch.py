"""Wide pinch: flexor against extensor bends the PIP alone, if the DIP is stiff enough to stay.

A flexor's moment arm grows with flexion and an extensor's shrinks, so that both together soften a joint by some 4.4 mm
times the tension of AF. The nominal DIP has no stiffness left at 8.1 N; the robot `exo_index/wide_pinch` has a stiffer
DIP and a softer PIP. Each is pulled along the line on which AE balances AF at the resting DIP, and beyond it.

Run: python examples/wide_pinch.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import exodrake as exo
from exodrake.data.plot import save_png

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
pulls = np.arange(1.0, 10.51, 0.5)  # tension of AF [N]

figure = Figure(figsize=(8.0, 3.4), layout="constrained")
panels = figure.subplots(1, 2, sharey=True)
for name, axes in zip(("exo_index", "exo_index/wide_pinch"), panels):
    robot = exo.load_robot(name)
    rest, pinch = robot.channels("finger.q0"), robot.grasps["wide-pinch"]
    share = pinch["AE"] / pinch["AF"]

    bends = []
    for pull in pulls:
        reference = exo.grasp("wide-pinch", robot, {"AF": pull, "MF": 0.3, "AE": share * pull}, hold=6.0)
        log = exo.simulate(robot, reference, seed=None, quantisation=False)
        bends.append(log.array("angle")[360] - rest)  # [rad] at 7.2 s, near the end of the hold
    bends = np.array(bends)

    at = int(np.abs(pulls - pinch["AF"]).argmin())
    moved = ", ".join(f"{joint} {bend:+.2f}" for joint, bend in zip(robot.machine.axes.joints, bends[at]))
    print(f"{name}: AF {pulls[at]:g} N, AE {share * pulls[at]:.2f} N bend {moved} rad from rest")
    for i, joint in enumerate(robot.machine.axes.joints):
        axes.plot(pulls, bends[:, i], "o-", ms=3.5, color=robot.machine.colours[joint], label=joint)
    axes.axvline(pinch["AF"], color="#888", ls=":", label="wide pinch")
    axes.set(xlabel=f"Tension of AF, AE {share:.2f} times that [N]", title=name)
panels[0].set_ylabel("Joint angle less rest [rad]")
panels[0].legend(frameon=False)
save_png(figure, folder / "wide_pinch.png")
