"""A caging grasp by a wearer whose joints are stiffer than planned, with and without a loop over the estimated angles.

Run: python examples/posture_loop.py [FOLDER]
"""

import sys
from pathlib import Path

import exodrake as exo
from exodrake.data.plot import save_png
from exodrake.estimator.quick import quick_estimator
from exodrake.grasping.posture_loop import posture_controller, posture_figure
from exodrake.grasping.run import run_plan

robot = exo.load_robot()
plan = exo.plan_grasp("caging", 0.050, robot)
stiffer = {f"finger.kappa.{joint}": 1.3 * robot[f"finger.kappa.{joint}"] for joint in plan.joints}
wearer = robot.with_parameters(stiffer)
estimator = quick_estimator(wearer)  # trained on the wearer's own sweeps
loop = posture_controller(plan, robot, hold=10.0)  # of the robot as planned

without = run_plan(plan, wearer, estimator, seed=1, hold=10.0)
with_loop = run_plan(plan, wearer, estimator, seed=1, hold=10.0, controller=loop)

last = slice(525, 570)  # frames of 20 ms at the end of the hold
print("joint   wanted   planned tensions   posture loop [rad]")
for joint, wanted in zip(plan.joints, plan.planned):
    reached = (log[f"angle_{joint}"][last].mean() for log in (without, with_loop))
    print(f"{joint}     {wanted:.3f}    " + "              ".join(f"{angle:.3f}" for angle in reached))
save_png(posture_figure(plan, without, with_loop), Path(*sys.argv[1:2]) / "posture_loop.png")
