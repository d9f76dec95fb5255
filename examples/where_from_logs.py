"""From logs to "where", without naming an effect: frequency response of each block, a fit, and many runs of the result.

Run: python examples/where_from_logs.py [FOLDER]
"""

import sys
from pathlib import Path

import exodrake as exo
from exodrake.analysis.log_response import block_responses, plot_responses
from exodrake.analysis.sweep import plot_sweep
from exodrake.data.plot import save_png

MADE = Path(sys.argv[1] if len(sys.argv) > 1 else ".")

# a stand-in for a real robot: friction in the sheaths of its tendons
nominal, mu = exo.load_robot(), "tendon.capstan_friction.mu_phi"
real = nominal.splice("tendon.capstan_friction", {"mu_phi": 0.24})
chirp, caging = exo.simulate(real, "chirp", seed=1), exo.simulate(real, "caging", seed=2)

# 1. where: the motor responds as its model, the tendon and the finger do not
print(exo.frequency_response(chirp, "speed_cmd_AF", "stroke_AF", nominal))
print(exo.frequency_response(chirp, "tension_AF", "angle_PIP", nominal))

# 2. a fit of the friction that this points to, judged on a grasp that was held out
start = nominal.splice("tendon.capstan_friction")
found = exo.fit(start, chirp, [mu, "finger.kappa.PIP"], held_out=[caging])
print(found)
print(found.table)
save_png(found.plot(), MADE / "fit.png", 80)
blocks = block_responses(chirp, {"nominal": nominal, "improved": found.robot})
shown = [one for one in blocks if one.output in ("stroke_AF", "tension_AF", "angle_PIP")]
save_png(plot_responses(shown), MADE / "response.png", 80)

# 3. many runs: how the grasp depends on friction and stiffness, and how well the fit knows it
table = exo.sweep(nominal, {mu: [0.0, 0.1, 0.2, 0.3, 0.4], "finger.kappa.PIP": [0.05, 0.06, 0.07]}, "caging")
print(table[[mu, "finger.kappa.PIP", "angle_PIP peak", "angle_PIP rms"]].to_string(index=False))
columns = [mu, "finger.kappa.PIP", *(f"angle_{joint} rms" for joint in nominal.machine.axes.joints)]
save_png(plot_sweep(table[columns]), MADE / "sweep.png", 80)
closed = exo.sweep(found.robot, found.draw(40), "caging", {"peak": lambda log: log["angle_PIP"].max()})["peak"]
truth = exo.simulate(real, "caging", seed=None)["angle_PIP"].max()
print(f"PIP closes to {closed.mean():.3f} +- {closed.std():.3f} rad, truth {truth:.3f}")
