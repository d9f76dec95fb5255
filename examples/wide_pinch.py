"""Wide pinch: flexor against extensor bends the PIP alone, until the DIP snaps into flexion.

The flexors' moment arms grow with flexion and the extensor's shrinks, so pulling both against each other softens the
DIP, whose own spring is the weakest. Run: python examples/wide_pinch.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import exodrake as exo
from exodrake.data.plot import save_png

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
robot = exo.load_robot()
pinch = robot.grasps["wide-pinch"]
shares = np.linspace(0.60, 0.88, 15)  # tension of AE over tension of AF

held = []
for share in shares:
    reference = exo.grasp("wide-pinch", robot, {**pinch, "AE": share * pinch["AF"]}, hold=6.0)
    log = exo.simulate(robot, reference, seed=None, quantisation=False)
    held.append(log.array("angle")[360])  # [rad] at 7.2 s, near the end of the hold
held = np.array(held)

at = int(np.abs(shares - pinch["AE"] / pinch["AF"]).argmin())
print(f"AE at {shares[at]:.2f} of AF: MCP {held[at, 0]:.2f}, PIP {held[at, 1]:.2f}, DIP {held[at, 2]:.2f} rad")
jump = int(np.abs(np.diff(held[:, 2])).argmax())
before, after = held[jump, 2], held[jump + 1, 2]
print(f"between {shares[jump]:.2f} and {shares[jump + 1]:.2f} the DIP goes from {before:.2f} to {after:.2f} rad")

figure = Figure(figsize=(5.5, 3.4), layout="constrained")
axes = figure.subplots()
for i, joint in enumerate(robot.machine.axes.joints):
    axes.plot(shares, held[:, i], "o-", ms=3.5, color=robot.machine.colours[joint], label=joint)
axes.axvline(pinch["AE"] / pinch["AF"], color="#888", ls=":", label="wide pinch")
axes.set(xlabel="Tension of AE over tension of AF", ylabel="Joint angle [rad]", title="Wide pinch, AF at 9 N")
axes.legend(frameon=False)
save_png(figure, folder / "wide_pinch.png")
