"""Noise of a robot whose loop hunts: in closed loop that of its own runs.

Friction at a sensor or a dead zone makes a loop hunt. Noise and rounding then decide when it slips, so that no run
repeats, and the robot without noise differs from its own logs by far more than the noise of a quiet robot.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.comparison import power
from exodrake.diagnosis.likelihood import COUNTING, NOISE_RUNS, Likelihood, duration, moved_a_little, written_by
from exodrake.diagnosis.p_values import exceeding
from exodrake.diagnosis.problem import by_trial
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.refine import Explanation

REJECTED = 1e-4  # p-value of a fit that no draw of noise or of an error of a law tells apart


class Noise:
    """Draws of noise for explanations.

    Those of the retuned robot serve all whose closed loop leaves no more, and all that prediction errors reject.
    Others have those of their own robot in closed loop, simulated once.

    Args:
        likelihood: views of the case.
        draws: their number.

    Attributes:
        retuned: (draws, samples) of the retuned robot [noise_std].
        own: explanation -> (draws, samples) of its own robot.
    """

    def __init__(self, likelihood: Likelihood, draws: int) -> None:
        self.retuned = likelihood.noise_draws(draws, np.random.default_rng(1))
        self.own: dict[Explanation, np.ndarray] = {}

    def of(self, e: Explanation) -> np.ndarray:
        """Draws (draws, samples) for an explanation."""
        return self.own.get(e, self.retuned)

    def measured(self, project: Projection, law: np.ndarray) -> np.ndarray:
        """Draws (draws, samples) for an explanation, simulated where they are needed.

        law: (draws, samples) errors of its laws.
        """
        e, likelihood = project.explanation, project.likelihood
        if not self.known(likelihood, e):
            noise, error, own = (likelihood.split(rows) for rows in (self.retuned, law, e.residual))
            if exceeding(power(noise[-1]) + power(error[-1]), float(power(own[-1]))) >= REJECTED:
                self.own[e] = own_draws(likelihood, e, len(self.retuned))
        return self.of(e)

    def known(self, likelihood: Likelihood, e: Explanation) -> bool:
        """Whether nothing is to be simulated for an explanation: its closed loop is quiet, or was simulated before."""
        if not e.effects or e in self.own or len(likelihood.views) == 1:
            return True
        noise, own = (likelihood.split(rows)[0] for rows in (self.retuned, e.residual))
        return exceeding(power(noise), float(power(own))) > ALPHA

    def levels(self, likelihood: Likelihood, *explanations: Explanation) -> np.ndarray:
        """Reduced chi-squares (views,) of the noisiest of some explanations: 1 where noise is the retuned robot's."""
        found = np.ones(len(likelihood.views))
        for own in (self.own[e] for e in explanations if e in self.own):
            found[0] = max(float(np.mean(likelihood.split(own)[0] ** 2)), found[0])
        return found


def own_draws(likelihood: Likelihood, e: Explanation, draws: int) -> np.ndarray:
    """Draws (draws, samples) of noise, in closed loop from logs that the robot of an explanation would write."""
    view, runs = likelihood.views[0], []
    with COUNTING:
        likelihood.simulated["hunting"] += NOISE_RUNS * duration(view.problem)  # written, then simulated
    for seed, robot in enumerate(moved_a_little(view.problem, e.robot)):
        written = replace(view, problem=written_by(view.problem, robot, seed))
        alone = replace(likelihood, views=(written,), stage="hunting")
        runs.append(by_trial(alone.residual(robot[None])[0], view.problem.fit))
    own = replace(likelihood, views=(replace(view, noise=tuple(runs)), *likelihood.views[1:]))
    return own.noise_draws(draws, np.random.default_rng(1))
