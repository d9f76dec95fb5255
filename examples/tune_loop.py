"""Choose the gains of the tension loop: the fastest with a disk margin of 0.7 and little overshoot.

Tunes the robot's own law alone, for the nominal robot at its three operating points, in some minutes; `exodrake tune`
compares further controllers and allows for tolerances. Writes the robot file and the figure of both loops.

Run: python examples/tune_loop.py [FOLDER]
"""

import sys
from pathlib import Path

import exodrake as exo
from exodrake.analysis.figures import plot_tuning
from exodrake.data.plot import save_png

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "tuned")
folder.mkdir(parents=True, exist_ok=True)
wanted = exo.Requirements(overshoot=0.05, disk_margin=0.7)
tuning = exo.tune(exo.load_robot(), wanted, only=("PD",), draws=0, judges=2)
for controller in tuning.compared:
    print(f"{controller.name}: settles in {controller.settling:.2f} s, disk margin {controller.disk_margin:.2f}")
    for name, value in controller.gains.items():
        print(f"  {name} = {value:.4g}")
if tuning.best:
    exo.write_robot(tuning.best.robot, folder / "tuned.yaml")
save_png(plot_tuning(tuning), folder / "tuning.png")
