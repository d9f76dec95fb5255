"""Use of the tolerances: how far an explanation moves the nominal parameters, and how far it may.

A fit knows noise alone, so that nominal parameters imitate the error of an effect's law, too. Those of the robot that
moves them least count therefore, among all that leave no more than noise and that error.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.calibration import Calibration, spread
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.refine import Explanation

STRONGEST = 1e4  # factor of the prior precisions beside which nominal parameters stay as they are
HALVINGS = 12  # of the logarithm of that factor


def tolerance_use(e: Explanation) -> float:
    """Mean square change of the nominal parameters in standard deviations of their tolerances [-]."""
    return mean_square(e.use[: e.nominal])


def mean_square(values: np.ndarray) -> float:
    """Mean square of values (n,); 0 of none."""
    return float(np.mean(values**2)) if len(values) else 0.0


def least_use(project: Projection, consistent: Callable[[np.ndarray], bool]) -> float:
    """The same for the robot that moves them least among those that the logs do not reject, by the linearisation.

    The fit is repeated with ever stronger priors of the nominal parameters (ridge regression; Hoerl & Kennard 1970).

    Args:
        project: of an explanation.
        consistent: whether the logs do not reject a residual (samples,).
    """
    e, low, high = project.explanation, 0.0, np.log10(STRONGEST)
    found = tolerance_use(e)
    if not e.effects or not consistent(e.residual):
        return found
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        move = project.held(10.0**middle)
        if consistent(e.residual + move @ project.columns):
            low, found = middle, mean_square(((e.x + move) / e.prior_std)[: e.nominal])
        else:
            high = middle
    return found


def most_use(project: Projection, calibration: Calibration, noise: np.ndarray) -> float:
    """Largest plausible mean square change of the nominal parameters, in tolerances.

    That of healthy robots drawn from the tolerances, and without an effect at least what they show when they are
    retuned in noise: longer logs reveal more of it.

    Args:
        project: of an explanation.
        calibration: of the machine.
        noise: (draws, samples) of the retuned robot.
    """
    e = project.explanation
    if not e.nominal:
        return calibration.moved
    if e.effects:
        return max(calibration.moved, spread(e.nominal))
    found = project.retuned(noise, np.random.default_rng(3)) / e.prior_std[:, None]
    return max(calibration.moved, float(np.quantile(np.mean(found**2, axis=0), 1.0 - ALPHA)))
