"""Estimate of the joint angles of a log, the zeros of its strokes corrected if they have moved since the training."""

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.log import Log
from exodrake.estimator.dataset import session_of
from exodrake.estimator.gp import Estimator
from exodrake.estimator.stroke_zeros import Zeros
from exodrake.estimator.validate import Score, score


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated joint angles of a log.

    Attributes:
        log: The log with `angle_est` and `angle_std` columns.
        flagged: Fraction of samples unlike the training sweeps [-].
        score: Score over the rows with measured angles, or None without any.
        zeros: Zeros of the strokes against the training; None of an estimator that cannot tell.
    """

    log: Log
    flagged: float
    score: Score | None
    zeros: Zeros | None


def estimate(estimator: Estimator, log: Log, correct: bool = True) -> Estimate:
    """Estimate the joint angles of a log, a session of its own.

    Args:
        estimator: The trained estimator.
        log: Log with tension and stroke.
        correct: Move the zeros of the strokes to those of the log if they have moved since the training.

    Raises:
        InputError: For other wires or joints than the estimator's, and for missing tensions or strokes.
    """
    session, measured = session_of(log, estimator.wires, estimator.joints), log.names("angle")
    if measured and set(measured) != set(estimator.joints):
        raise InputError(
            f"{log.label}: joints {', '.join(measured)}, the estimator's are {', '.join(estimator.joints)}"
        )
    zeros = estimator.zeros(session) if estimator.strokes else None
    if correct and zeros is not None and zeros.moved:
        estimator = estimator.corrected(zeros, session)
    mean, std, flag = estimator.predict(session.tension, session.stroke)
    new = log.with_array("angle_est", estimator.joints, mean).with_array("angle_std", estimator.joints, std)
    angle = log.array("angle", estimator.joints) if measured else session.angle
    seen = np.isfinite(angle).all(axis=1)
    judged = score("estimator", log.label, angle[seen], mean[seen], std[seen]) if seen.any() else None
    return Estimate(new, float(np.mean(flag)), judged, zeros)
