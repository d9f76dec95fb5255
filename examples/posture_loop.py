"""A caging grasp by a wearer whose joints are stiffer than planned, with and without a loop over the estimated angles.

Run: python examples/posture_loop.py [FOLDER]
"""

import sys
from pathlib import Path

import matplotlib

import exodrake as exo
from exodrake.data.plot import STYLE, new_figure, save_png
from exodrake.estimator.gp import quick_estimator
from exodrake.grasping.plan import posture_controller, run_plan

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

matplotlib.rcParams.update(STYLE)
figure, time = new_figure(9.0, 5.2), with_loop.time
panels = figure.subplots(2, 3, sharex=True, sharey="row")
runs = (("planned tensions alone", without, "#8c8c8c"), ("posture loop", with_loop, "#0072b2"))
for above, below, joint, tendon in zip(*panels, plan.joints, plan.tendons):
    above.plot(time, with_loop[f"angle_ref_{joint}"], color="#222222", ls="--", lw=1.2, label="wanted")
    for label, log, colour in runs:
        above.plot(time, log[f"angle_{joint}"], color=colour, label=label)
        below.plot(time, log[f"tension_ref_{tendon}"], color=colour)
    above.plot(time, with_loop[f"angle_est_{joint}"], color="#d55e00", lw=0.8, label="its estimate")
    above.set_title(joint)
    below.set(title=tendon, xlabel="Time [s]")
panels[0, 0].set_ylabel("Angle [rad]")
panels[1, 0].set_ylabel("Tension reference [N]")
panels[0, 2].legend(loc="upper left", bbox_to_anchor=(1.0, 1.04), handlelength=1.8)
save_png(figure, Path(*sys.argv[1:2]) / "posture_loop.png")
