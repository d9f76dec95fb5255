"""Caging grasp of an object, by the nominal robot and by one with sheath friction.

Run: python examples/caging.py [FOLDER]
"""

import sys
from pathlib import Path

import exodrake as exo
from exodrake.data.plot import save_png
from exodrake.diagrams.meshcat import Thing, recording_html

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
robot = exo.load_robot()
rough = robot.splice("tendon.capstan_friction", {"mu_phi": 0.3})
reference = exo.grasp("caging", robot)
nominal, with_friction = exo.simulate(robot, reference), exo.simulate(rough, reference)

hold = slice(150, 195)  # frames of 20 ms near the end of the hold
print("joint   nominal   with sheath friction [rad]")
for joint in ("MCP", "PIP", "DIP"):
    column = f"angle_{joint}"
    print(f"{joint}     {nominal[column][hold].mean():.3f}     {with_friction[column][hold].mean():.3f}")

save_png(nominal.plot("Caging", with_friction, ("nominal", "sheath friction"), robot.machine), folder / "caging.png")
glue = Thing(centre=(0.018, -0.036), radius=0.011, length=0.06)  # a glue stick, where the curled finger touches it [m]
(folder / "caging.html").write_text(recording_html(nominal, robot, "Caging", glue))
print(f"caging.png and caging.html are in {folder.resolve().name}/")
