"""Data against model: angles on held-out sweeps from the estimator, the ridge and the paper's statics (its Fig. 11)."""

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.estimator.dataset import Sweeps
from exodrake.estimator.gp import POINTS, fit
from exodrake.estimator.validate import fit_ridge
from exodrake.physics.finger_statics import follow, posture
from exodrake.physics.tendon_finger import Parameters
from studies.paper.stiffness import Stiffness, fit_stiffness, linear


@dataclass(frozen=True)
class Comparison:
    """Errors on held-out sweeps.

    Attributes:
        rmse: RMSE (joints,) [rad] by method.
        stiffness: The fitted constant stiffness.
        solved: Fraction of rows in which the constant-stiffness model has an equilibrium; its RMSE is over those rows.
    """

    rmse: dict[str, np.ndarray]
    stiffness: Stiffness
    solved: float


def compare(training: Sweeps, held_out: Sweeps, n: Parameters, points: int = POINTS) -> Comparison:
    """Fit every method on training sweeps and compare them on held-out sweeps.

    Methods: Gaussian process; quadratic ridge; constant stiffness (fitted, no end stops, Eq. 20-21: the paper's
    model-based estimate); end stops (fitted stiffness, known stops); nominal (nothing fitted). The models see tension
    only.

    Args:
        training: Sweeps to train and fit on.
        held_out: Sweeps to compare on.
        n: Parameters of the finger, with the routers and end stops of the models.
        points: Training points of the Gaussian process.

    Raises:
        InputError: If the wires or joints are not three, or differ between the two.
    """
    for sweeps in (training, held_out):
        if len(sweeps.wires) != 3 or len(sweeps.joints) != 3:
            raise InputError(
                f"the finger's statics have 3 wires and 3 joints, not {len(sweeps.wires)} and {len(sweeps.joints)}"
            )
    if (training.wires, training.joints) != (held_out.wires, held_out.joints):
        raise InputError("training and held-out sweeps differ in wires or joints")
    process = fit(training, points).predict(held_out.tension, held_out.stroke)[0]
    constant = fit_stiffness(training.tension, training.angle, linear(n), posture)
    stopped = fit_stiffness(training.tension, training.angle, n)
    guesses = {
        "Gaussian process": process,
        "quadratic ridge": fit_ridge(training)(held_out)[0],
        "constant stiffness": posture(held_out.tension, constant.parameters(linear(n))),
        "end stops": follow(held_out.tension, stopped.parameters(n)),
        "nominal": follow(held_out.tension, n),
    }
    solved = np.isfinite(guesses["constant stiffness"]).all(axis=1)
    rmse = {name: np.sqrt(np.nanmean((guess - held_out.angle) ** 2, axis=0)) for name, guess in guesses.items()}
    return Comparison(rmse, constant, float(np.mean(solved)))
