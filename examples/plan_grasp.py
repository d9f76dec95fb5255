"""Plan grasps of several objects: tensions for those within reach of the wires, and the reason for the others.

Run: python examples/plan_grasp.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

import exodrake as exo
from exodrake.data.plot import save_png
from exodrake.estimator.gp import quick_estimator
from exodrake.grasping.plan import at_hold, grasp_figure, run_plan

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
robot = exo.load_robot()

for mode, size in (("narrow-pinch", 0.03), ("wide-pinch", 0.06), ("caging", 0.06), ("caging", 0.08)):
    plan = exo.plan_grasp(mode, size, robot)
    tensions = ", ".join(f"{tendon} {pull:.1f} N" for tendon, pull in zip(plan.tendons, plan.tensions))
    print(f"{mode} of {1e3 * size:.0f} mm: {tensions}")
    if not plan.feasible:
        print(f"  {plan.reason}")
        continue
    log = exo.simulate(robot, plan.reference(robot))
    error = np.abs(at_hold(log, "angle", plan.joints) - plan.planned)
    print(f"  reached within {error.max():.3f} rad")

plan = exo.plan_grasp("caging", 0.06, robot)
log = run_plan(plan, robot, quick_estimator(robot))  # the Drake Diagram with the estimator in slot 8
save_png(grasp_figure(plan, log, robot), folder / "caging_60mm.png")
print(f"caging_60mm.png is in {folder.resolve().name}/")
