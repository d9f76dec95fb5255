"""Sessions of a case: its logs by date, or windows of one long log; and an effect's parameters session by session.

All sessions share the nominal parameters and the further parameters of effects; each has amplitudes of its own. One
Gauss-Newton step from the fit to all sessions gives these amplitudes:

    dx = -H^-1 (J'W r + P x),   H = J'W J + P,   covariance  H^-1 (J'W (1 + D) W J + P) H^-1

J: columns of the shared parameters, and of each session's own ones on its rows alone; W: weights of the cost; P: prior
precision; D: covariance of the laws' errors (`levels`), which are alike in sessions of one motion and so cancel.
Logs by date are simulated again with what their session has found, and the step is repeated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from exodrake.data.case import Case
from exodrake.diagnosis.change_point import LEAST
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.projection import RIDGE
from exodrake.diagnosis.refine import FREE, Explanation, whole_jacobian

DAY = 86400.0  # s
ROUNDS = 5  # further steps of logs by date at most: the first is exact where the parameters act in proportion
CONVERGED = 0.1  # standard deviations of the own parameters: a smaller step is the last one
WINDOW = 10.0  # s of a long log that count as a session at least: longer than the memory of the loops
MOST_WINDOWS = 24  # of a long log


@dataclass(frozen=True, eq=False)
class Session:
    """A session.

    Attributes:
        name: its date, or the window of the log.
        time: days since the first session's date; of a window its middle [s].
        logs: positions of its logs among those that are fitted.
        frames: window (first, end) of the log in frames; None for whole logs.
    """

    name: str
    time: float
    logs: tuple[int, ...]
    frames: tuple[int, int] | None = None


def dated_sessions(case: Case, names: Sequence[str]) -> tuple[Session, ...]:
    """Sessions of fitted logs by date, in order; none if a log has no date.

    Args:
        case: the case.
        names: files of the fitted logs, in order.
    """
    from exodrake.data.case import written_date

    dates = {item.file: item.date for item in case.logs}
    found = [dates[name] for name in names]
    known = sorted({date for date in found if date is not None})
    if any(date is None for date in found) or not known:
        return ()
    days = [(date - known[0]).total_seconds() / DAY for date in known]
    logs = [tuple(k for k, one in enumerate(found) if one == date) for date in known]
    return tuple(Session(written_date(d), t, own) for d, t, own in zip(known, days, logs, strict=True))


def windows(frames: int, frame: float) -> tuple[Session, ...]:
    """Windows of one log of so many frames of `frame` [s], of equal length; none if it is too short for a change."""
    count = min(int(frames * frame / WINDOW), MOST_WINDOWS)
    if count < LEAST:
        return ()
    ends = np.linspace(0, frames, count + 1).round().astype(int)
    return tuple(
        Session(f"{a * frame:.0f} to {b * frame:.0f} s", 0.5 * (a + b) * frame, (0,), (int(a), int(b)))
        for a, b in pairwise(ends)
    )


def rows_of(likelihood: Likelihood, session: Session) -> np.ndarray:
    """Mask (samples,) of the residual's samples in a session."""
    return likelihood.samples_of(session.logs, session.frames)


def part_of(likelihood: Likelihood, session: Session) -> Likelihood:
    """The likelihood of a session's logs alone."""

    def chosen(problem):
        return replace(problem, fit=tuple(problem.fit[k] for k in session.logs))

    views = tuple(replace(view, problem=chosen(view.problem), noise=()) for view in likelihood.views)
    return replace(likelihood, views=views)


class Step:
    """One Gauss-Newton step from an explanation, with parameters shared by all sessions and own ones of each.

    Args:
        e: explanation.
        jacobians: of each session (parameters, samples).
        weights: of each session (samples,), of residuals.
        own: positions of the parameters that each session has for itself.
    """

    def __init__(
        self, e: Explanation, jacobians: Sequence[np.ndarray], weights: Sequence[np.ndarray], own: Sequence[int]
    ) -> None:
        self.own, self.count = list(own), len(jacobians)
        self.shared = [i for i in range(len(e.parameters)) if i not in self.own]
        first, width = len(self.shared), len(self.own)
        self.columns = [j[[*self.shared, *self.own]] for j in jacobians]
        self.squares = [w.astype(float) ** 2 for w in weights]
        self.places = [np.r_[0:first, first + s * width : first + (s + 1) * width] for s in range(self.count)]
        normal = np.zeros((first + self.count * width,) * 2)
        noise = np.zeros_like(normal)
        for columns, w, at in zip(self.columns, self.squares, self.places, strict=True):
            normal[np.ix_(at, at)] += (columns * w) @ columns.T
            noise[np.ix_(at, at)] += (columns * w**2) @ columns.T
        free = np.array([1.0 / (FREE * e.parameters[i].scale) ** 2 for i in self.own])
        self.precision = np.r_[1.0 / e.prior_std[self.shared] ** 2, np.tile(free, self.count)]
        self.inverse = np.linalg.inv(normal + np.diag(self.precision + RIDGE * np.diag(normal)))
        self.noise = self.inverse @ (noise + np.diag(self.precision)) @ self.inverse

    def pull(self, rows: Sequence[np.ndarray]) -> np.ndarray:
        """Gradient (unknowns, n) of half the sum of squares of rows (n, samples) of each session."""
        out = np.zeros((len(self.precision), len(rows[0])))
        for columns, w, at, row in zip(self.columns, self.squares, self.places, rows, strict=True):
            out[at] += (columns * w) @ row.T
        return out

    def __call__(self, x: np.ndarray, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """Coordinates after the step (sessions, parameters), from those before it and each session's residual."""
        start = np.r_[x[0, self.shared], x[:, self.own].ravel()]
        found = start - self.inverse @ (self.pull([r[None] for r in residuals])[:, 0] + self.precision * start)
        out = x.copy()
        out[:, self.shared] = found[: len(self.shared)]
        out[:, self.own] = self.series(found[:, None])[:, :, 0].T
        return out

    def small(self, moves: np.ndarray) -> bool:
        """Whether changes (sessions, parameters) of the own parameters are small against their noise."""
        std = self.series(np.sqrt(np.maximum(np.diag(self.noise), 0.0))[:, None])[:, :, 0].T
        return bool(np.all(np.abs(moves[:, self.own]) <= CONVERGED * std))

    def series(self, unknowns: np.ndarray) -> np.ndarray:
        """Own parameters by session (own, sessions, n) of unknowns (unknowns, n)."""
        return unknowns[len(self.shared) :].reshape(self.count, len(self.own), -1).transpose(1, 0, 2)

    def covariance(self, errors: Sequence[np.ndarray]) -> np.ndarray:
        """Covariance (own, sessions, sessions) of each own parameter, by noise and by errors (draws, samples)."""
        first, width = len(self.shared), len(self.own)
        moves = self.series(self.inverse @ self.pull(errors))
        places = [first + k + width * np.arange(self.count) for k in range(width)]
        return np.array([self.noise[np.ix_(at, at)] + np.cov(m) for at, m in zip(places, moves, strict=True)])


@dataclass(frozen=True, eq=False)
class Estimates:
    """Coordinates of parameters session by session.

    Attributes:
        x: (sessions, own) coordinates.
        covariance: (own, sessions, sessions) of each parameter's series.
        residuals: of each session (samples,), with its own parameters.
    """

    x: np.ndarray
    covariance: np.ndarray
    residuals: list[np.ndarray]


def estimates(
    likelihood: Likelihood, e: Explanation, sessions: Sequence[Session], own: Sequence[int], errors: np.ndarray,
    rounds: int = ROUNDS,
) -> Estimates:  # fmt: skip
    """Parameters of an explanation session by session, the others shared.

    Args:
        likelihood: views that the explanation was fitted to, scaled to what it leaves.
        e: the explanation.
        sessions: of these logs.
        own: positions of the parameters that each session has for itself.
        errors: (draws, samples) of the laws, at their largest.
        rounds: further steps of logs by date at most.
    """
    rows = [rows_of(likelihood, session) for session in sessions]
    whole = whole_jacobian(likelihood, e)
    jacobians, residuals = [whole[:, r] for r in rows], [e.residual[r] for r in rows]
    weights, x = [likelihood.weights[r] for r in rows], np.tile(e.x, (len(sessions), 1))
    step = Step(e, jacobians, weights, own)
    moved = step(x, residuals)
    parts = [part_of(likelihood, session) for session in sessions] if sessions[0].frames is None else []
    for _ in range(rounds if parts else 0):
        here = [at(part, e, row, j) for part, row, j in zip(parts, moved, jacobians, strict=True)]
        jacobians, residuals = (
            [whole_jacobian(p, one) for p, one in zip(parts, here, strict=True)],
            [one.residual for one in here],
        )
        step, x = Step(e, jacobians, weights, own), np.array([one.x for one in here])
        moved = step(x, residuals)
        if step.small(moved - x):
            break
    left = [r + (b - a) @ j for r, a, b, j in zip(residuals, x, moved, jacobians, strict=True)]
    size = amplitude(left, [errors[:, r] for r in rows])
    return Estimates(moved[:, list(own)], step.covariance([size * errors[:, r] for r in rows]), left)


def amplitude(left: Sequence[np.ndarray], errors: Sequence[np.ndarray]) -> float:
    """Amplitude of errors of the laws (draws, samples), 1 at most, that explains what is left beside white noise."""
    excess = sum(float(r @ r) - len(r) for r in left)
    power = sum(float(np.mean(np.einsum("ij,ij->i", rows, rows, dtype=float))) for rows in errors)
    return float(np.sqrt(np.clip(excess / max(power, 1e-9), 0.0, 1.0)))


def at(part: Likelihood, e: Explanation, x: np.ndarray, jacobian: np.ndarray) -> Explanation:
    """An explanation on a session's logs at coordinates x (parameters,), within bounds."""
    return replace(e, jacobian=jacobian[: e.nominal]).at(part, np.clip(x, *e.bounds))
