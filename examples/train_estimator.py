"""Train the joint-angle estimator on simulated sweeps, validate it under two splits, and apply it to a grasp.

The simulated wearer is the same in every sweep, so the errors are smaller than those of a real wearer.
"""

import exodrake as exo
from exodrake.estimator.dataset import sweeps_from_logs
from exodrake.estimator.gp import condition, learn
from exodrake.estimator.validate import estimate, validate

robot = exo.load_robot()
training = sweeps_from_logs([exo.simulate(robot, exo.sweeps(robot), seed=0)])
print(f"{training.count} sweeps, {len(training)} rows")

prior = learn(training, points=250)  # covariance: seconds at 500 points
estimator = condition(prior, training, points=250)
for score in validate(prior, training, points=250):
    print(f"{score.method:17} {score.split:16} RMSE {score.mean_rmse:.4f} rad")

for name in ("caging", "narrow-pinch", "wide-pinch"):
    log = exo.simulate(robot, exo.grasp(name), seed=1)
    _, flagged, score = estimate(estimator, log)
    print(f"{name:17} RMSE {score.mean_rmse:.4f} rad, {100 * flagged:.0f} % of samples unlike the training sweeps")
