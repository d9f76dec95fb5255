"""Gaussian process over sweeps: covariance, zeros of the strokes, leave-one-sweep-out, the flat arrays for prediction.

An estimator file holds arrays and one JSON record in an .npz, without pickle. It is refused for a log of other wires or
joints, and for a robot file of another signature.
"""

from __future__ import annotations

import io
import json
import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize
from scipy.stats import f as fisher
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, DotProduct, Kernel, Matern, Sum, WhiteKernel

from exodrake import __version__
from exodrake.core.confidence import NORMAL_95
from exodrake.core.errors import InputError, short_repr
from exodrake.core.files import read_bytes
from exodrake.core.parallel import thread_limit
from exodrake.core.provenance import robot_digest
from exodrake.data.formats.npz import read_arrays
from exodrake.estimator.dataset import Sweeps, sweeps_from_logs
from exodrake.model.robot import Robot
from exodrake.physics.gp_estimator import Weights, predict_rows
from exodrake.simulation.protocols import sweeps
from exodrake.simulation.simulate import simulate

POINTS = 500
JITTER = 1e-10  # scikit-learn's default, added to the diagonal
ALONE = 1e-2  # length scale over the labels of sweeps, at which the covariance of labels 1 apart is exactly 0
EVALUATIONS = 60  # of the marginal likelihood, which has converged by then
STROKE_POINTS = 250  # training rows: strokes follow tensions smoothly
ROWS = 200  # rows of a session, equispaced
TOLERANCE = 7e-5  # m; a shift as small costs up to 0.01 rad (MF 0.14 rad/mm), a third of the paper's 0.03 rad
FALSE = 0.01  # probability that zeros which have not moved count as moved
UNLIKE = 4.0  # standard deviations by which the reduced chi-square of a session exceeds that of training sweeps
# Quantile of the held-out variances that is the limit; new sweeps at trained levels exceed it about 1 % of the time
OWN = 0.975
# The hyperparameters were learnt with the held-out sweep included, so residuals are too small: measured on new sweeps
ALLOWANCE = 1.1
FORMAT = "exodrake estimator 1"
STROKES = ("strokes_tension", "strokes_stroke", "strokes_sweep", "strokes_time", "strokes_theta")
QUICK_POINTS = 250  # of a quick estimator: some s of training
UNITS = {"tension": "N", "stroke": "m", "angle": "rad", "time": "s"}


class OnColumns(Kernel):
    """Kernel on some columns of its input; its hyperparameters are those of the inner kernel."""

    hyperparameters = property(lambda self: [h._replace(name=f"kernel__{h.name}") for h in self.kernel.hyperparameters])
    bounds = property(lambda self: self.kernel.bounds)
    theta = property(lambda self: self.kernel.theta, lambda self, theta: setattr(self.kernel, "theta", theta))

    def __init__(self, kernel, columns):
        self.kernel = kernel
        self.columns = columns

    def __call__(self, X, Y=None, eval_gradient=False):
        """Covariance (n, m) of rows X (n, columns) and Y (m, columns)."""
        columns = list(self.columns)
        return self.kernel(X[:, columns], None if Y is None else Y[:, columns], eval_gradient)

    def diag(self, X):
        """Prior variances (n,)."""
        return self.kernel.diag(X[:, list(self.columns)])

    def is_stationary(self):
        """Tell whether the inner kernel is stationary."""
        return self.kernel.is_stationary()


def sweep_kernel(inputs: int) -> Sum:
    """Build the covariance for `inputs` columns z and angles of unit variance, with start values and bounds.

        k = v_lin (1 + z . z') + v_rbf exp(-|(z - z') / ell|^2 / 2)
            + [same sweep] (v_sweep + v_drift exp(-|t - t'| / tau)) + v_noise [same row]

    Without the terms of a sweep the length scales absorb its correlated error, and more data makes a new sweep worse.
    """
    z, sweep, time = tuple(range(inputs)), (inputs,), (inputs + 1,)
    linear = ConstantKernel(1.0, (1e-3, 1e3)) * OnColumns(DotProduct(1.0, "fixed"), z)
    length = RBF(np.full(inputs, 2.0), (5e-2, 1e2))  # pyright: ignore
    curved = ConstantKernel(1.0, (1e-4, 1e3)) * OnColumns(length, z)
    same = OnColumns(RBF(ALONE, "fixed"), sweep)
    shared = ConstantKernel(1e-2, (1e-6, 1.0)) * same
    drift = ConstantKernel(1e-2, (1e-6, 1.0)) * same * OnColumns(Matern(1.0, (5e-2, 50.0), nu=0.5), time)
    return linear + curved + shared + drift + WhiteKernel(1e-3, (1e-7, 1.0))


@dataclass(frozen=True, eq=False)
class Prior:
    """Covariance and scaling: kernel over (z, sweep, time) with z = rotation (x - center), angle = offset + gain y."""

    kernel: Any
    center: np.ndarray
    rotation: np.ndarray
    offset: np.ndarray
    gain: np.ndarray

    def rows(self, sweeps: Sweeps) -> np.ndarray:
        """Inputs of the kernel (n, m + 2): z [-], sweep label, time [s]."""
        return np.column_stack([(sweeps.inputs - self.center) @ self.rotation.T, sweeps.sweep, sweeps.time])

    def targets(self, sweeps: Sweeps) -> np.ndarray:
        """Scaled angles (n, joints) [-]."""
        return (sweeps.angle - self.offset) / self.gain


def learn(sweeps: Sweeps, points: int = POINTS) -> Prior:
    """Fit scaling and hyperparameters by marginal likelihood, from the start values of `sweep_kernel`."""

    def optimise(objective, start, bounds):
        options = {"maxfun": EVALUATIONS}
        found = minimize(objective, start, method="L-BFGS-B", jac=True, bounds=bounds, options=options)
        return found.x, found.fun

    chosen = sweeps.select_equispaced(points)
    prior = scaled_prior(chosen)
    process = GaussianProcessRegressor(prior.kernel, alpha=JITTER, optimizer=optimise)  # pyright: ignore
    with thread_limit(), warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a variance at its lower bound is an effect that is absent
        process.fit(prior.rows(chosen), prior.targets(chosen))
    return replace(prior, kernel=process.kernel_)


def scaled_prior(sweeps: Sweeps) -> Prior:
    """Scale inputs and angles to unit variance, constant ones not, with the start values of `sweep_kernel`.

    Inputs are rotated to the principal axes of their correlation: combinations such as s - T / k carry the information.
    """
    center, width, gain = sweeps.inputs.mean(axis=0), sweeps.inputs.std(axis=0), sweeps.angle.std(axis=0)
    width, gain = np.where(width > 0, width, 1.0), np.where(gain > 0, gain, 1.0)
    unit = (sweeps.inputs - center) / width
    axes = np.linalg.eigh(unit.T @ unit)[1]
    return Prior(sweep_kernel(len(center)), center, axes.T / width, sweeps.angle.mean(axis=0), gain)


@dataclass(frozen=True)
class Zeros:
    """Shift (wires,) [m] of the stroke zeros of a session against training, with its covariance (wires, wires) [m2]."""

    wires: tuple[str, ...]
    shift: np.ndarray
    covariance: np.ndarray
    moved: bool  # whether the shift is more than variation between sweeps, and a constant explains the residuals
    unlike: bool  # whether a constant does not explain the residuals: contact, another wearer or robot

    @property
    def half_widths(self) -> np.ndarray:
        """95 % half widths (wires,) [m]."""
        return NORMAL_95 * np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class StrokeModel:
    """Strokes that training rows show at their tensions; `theta`: logarithms of the covariance's parameters."""

    rows: Sweeps
    theta: np.ndarray

    @cached_property
    def prior(self) -> Prior:
        """Covariance and scaling."""
        start = scaled_prior(self.rows)
        return replace(start, kernel=start.kernel.clone_with_theta(self.theta))

    @cached_property
    def inverse(self) -> np.ndarray:
        """K^-1 of the training rows (n, n) [-]."""
        eye = np.eye(len(self.rows))
        return cho_solve(cho_factor(self.prior.kernel(self.prior.rows(self.rows)) + JITTER * eye), eye)

    @cached_property
    def held_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Sigma (wires, wires) and the reduced chi-square (sweeps,) of each training sweep given the others [-]."""
        weighted, labels = self.inverse @ self.prior.targets(self.rows), np.unique(self.rows.sweep)
        shifts, left = [], []
        for label in labels:
            own = self.rows.sweep == label
            precision = self.inverse[np.ix_(own, own)]
            shift, kappa, chi2 = _constant(precision, np.linalg.solve(precision, weighted[own]))
            shifts.append(np.sqrt(kappa) * shift)
            left.append(chi2)
        return np.transpose(shifts) @ shifts / len(labels), np.array(left)

    def zeros(self, session: Sweeps) -> Zeros:
        """Estimate and test the zeros of a session from its tensions and strokes.

        Re-donning shifts the zero of each wire's stroke by a constant z. With residuals r (rows, wires) of covariance C
        z = r' C^-1 1 / kappa and Cov(z) = Sigma / kappa, with kappa = 1' C^-1 1 and Sigma from the training sweeps in
        turn. z counts as moved if z' (Cov(z) + TOLERANCE^2 I)^-1 z exceeds the quantile of Hotelling's T^2. A changed
        rest posture of the wearer looks the same. What a constant does not explain is reported and left alone.
        """
        prior, sigma, left = self.prior, *self.held_out
        chosen = stroke_rows(session).select_equispaced(ROWS)
        chosen = replace(chosen, sweep=chosen.sweep - chosen.sweep.min() + self.rows.sweep.max() + 1)
        known, new = prior.rows(self.rows), prior.rows(chosen)
        with thread_limit():
            cross = prior.kernel(new, known)
            residual = prior.targets(chosen) - cross @ (self.inverse @ prior.targets(self.rows))
            covariance = prior.kernel(new) - cross @ self.inverse @ cross.T + JITTER * np.eye(len(new))
            shift, kappa, chi2 = _constant(np.linalg.inv(covariance), residual)
        spread = np.outer(prior.gain, prior.gain) * sigma / kappa
        shift = prior.gain * shift
        distance = shift @ np.linalg.solve(spread + TOLERANCE**2 * np.eye(len(shift)), shift)
        unlike = bool(chi2 > left.mean() + UNLIKE * left.std() / np.sqrt(chosen.count))
        moved = bool(distance > hotelling(len(shift), self.rows.count))
        return Zeros(self.rows.wires, shift, spread, moved and not unlike, unlike)


def learn_strokes(sweeps: Sweeps) -> StrokeModel:
    """Learn the strokes of training sweeps from their tensions."""
    rows = stroke_rows(sweeps).select_equispaced(STROKE_POINTS)
    return StrokeModel(rows, learn(rows, STROKE_POINTS).kernel.theta)


def stroke_rows(sweeps: Sweeps) -> Sweeps:
    """Rows with tensions [N] as inputs and strokes [m] as outputs."""
    return replace(sweeps, inputs=sweeps.tension, angle=sweeps.stroke)


def hotelling(wires: int, sweeps: int) -> float:
    """Quantile of Hotelling's T^2 for the shift of some wires, its covariance about 0 estimated from some sweeps."""
    free = max(sweeps - wires + 1, 1)
    return wires * sweeps / free * float(fisher.ppf(1 - FALSE, wires, free))


def _constant(precision: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Constant (wires,), kappa and reduced chi-square of the rest, from precision (n, n) and residuals (n, wires)."""
    pulled = precision @ residual
    kappa = float(precision.sum())
    shift = pulled.sum(axis=0) / kappa
    left = residual - shift
    return shift, kappa, float(np.sum(left * (precision @ left))) / left.size


@short_repr
@dataclass(frozen=True, eq=False)
class Estimator:
    """Trained estimator."""

    wires: tuple[str, ...]
    joints: tuple[str, ...]
    weights: Weights  # arrays of the prediction
    limit: float  # variance ratio (see `predict_into`) beyond which a sample is unlike the training sweeps [-]
    robot: str = ""  # signature of the robot file, or ""
    logs: tuple[str, ...] = ()
    sweeps: int = 0  # number of training sweeps
    kernel: str = ""
    # strokes that the training shows at its tensions, for the zeros of a session; None if not learnt
    strokes: StrokeModel | None = None

    @cached_property
    def points(self) -> int:
        """Number of training points."""
        return len(self.weights.alpha)

    def predict(self, tension: np.ndarray, stroke: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean and standard deviation (rows, joints) [rad], and flag (rows,) of samples unlike the training sweeps.

        From tension (rows, wires) [N] and stroke (rows, wires) [m]. The flag is that of a sample: `zeros` finds
        re-donning with a whole session. It does not detect contact with an object, which changes tension and stroke
        along combinations seen in training.
        """
        mean, std, ratio = predict_rows(np.ascontiguousarray(tension), np.ascontiguousarray(stroke), self.weights)
        return mean, std, ratio > self.limit

    def zeros(self, session: Sweeps) -> Zeros:
        """Test whether the zeros of a session's strokes moved since the training. InputError without `strokes`."""
        if self.strokes is None:
            raise InputError("estimator without a model of the strokes: train it again to find the zeros of a session")
        return self.strokes.zeros(session)

    def correct_zeros(self, zeros: Zeros, session: Sweeps) -> Estimator:
        """Move the zeros to those of a session; the standard deviations grow by the uncertainty of the zeros."""
        wires, weights, some = len(self.wires), self.weights, session.select_equispaced(POINTS)
        moved = replace(self, weights=weights._replace(center=weights.center + np.r_[np.zeros(wires), zeros.shift]))
        mean, std, _ = moved.predict(some.tension, some.stroke)
        ways = np.linalg.cholesky(zeros.covariance).T
        added = [moved.predict(some.tension, some.stroke + way)[0] - mean for way in ways]
        wider = np.sqrt(1 + np.mean(np.sum(np.square(added), axis=0), axis=0) / np.mean(std**2, axis=0))
        return replace(moved, weights=moved.weights._replace(spread=weights.spread * wider))


def fit(sweeps: Sweeps, points: int = POINTS) -> Estimator:
    """Learn the covariance, condition on at most `points` rows equispaced in time, and learn the strokes."""
    return replace(condition(learn(sweeps, points), sweeps, points), strokes=learn_strokes(sweeps))


def condition(prior: Prior, sweeps: Sweeps, points: int = POINTS) -> Estimator:
    """Condition on at most `points` rows with a given covariance, and calibrate by leave-one-sweep-out.

    The residuals scale the standard deviation of each joint, the variances set the limit of samples that are flagged.
    """
    chosen = sweeps.select_equispaced(points)
    rows, targets = prior.rows(chosen), prior.targets(chosen)
    with thread_limit():
        factor = np.linalg.cholesky(prior.kernel(rows) + JITTER * np.eye(len(rows)))
        lower = solve_triangular(factor, np.eye(len(rows)), lower=True)
        inverse = lower.T @ lower
        residual, variance = leave_one_sweep_out(inverse, targets, chosen.sweep)
    without_noise, noise = prior.kernel.k1, prior.kernel.k2
    without_drift, drift = without_noise.k1, without_noise.k2
    (linear, curved), shared = (without_drift.k1.k1, without_drift.k1.k2), without_drift.k2
    rest = shared.k1.constant_value + drift.k1.k1.constant_value + noise.noise_level
    scale = ALLOWANCE / NORMAL_95 * np.quantile(np.abs(residual) / np.sqrt(variance)[:, None], 0.95, axis=0)
    weights = Weights(
        center=prior.center, rotation=np.ascontiguousarray(prior.rotation),
        points=np.ascontiguousarray(rows[:, : prior.rotation.shape[0]].T),
        shrink=1.0 / np.atleast_1d(curved.k2.kernel.length_scale),
        variances=np.array([linear.k1.constant_value, curved.k1.constant_value, rest]),
        alpha=np.ascontiguousarray(lower.T @ (lower @ targets)),
        factor=np.concatenate([lower[column:, column] for column in range(len(rows))]),
        offset=prior.offset, gain=prior.gain, spread=prior.gain * scale,
    )  # fmt: skip
    limit = float(np.quantile(variance / rest, OWN))
    return Estimator(
        chosen.wires, chosen.joints, weights, limit, logs=sweeps.logs, sweeps=sweeps.count, kernel=str(prior.kernel)
    )


def leave_one_sweep_out(inverse: np.ndarray, targets: np.ndarray, sweep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residual (n, joints) and variance (n,) [-] of each row, predicted from the other sweeps.

    y_B - mu_B = [K^-1]_BB^-1 [K^-1 y]_B and Cov(y_B) = [K^-1]_BB^-1 for sweep B, without a new fit (Rasmussen and
    Williams, section 5.4.2, with a block in place of a point).
    """
    weighted = inverse @ targets
    residual, variance = np.empty_like(targets), np.empty(len(targets))
    for label in np.unique(sweep):
        block = np.flatnonzero(sweep == label)
        covariance = np.linalg.inv(inverse[np.ix_(block, block)])
        residual[block] = covariance @ weighted[block]
        variance[block] = np.diag(covariance)
    return residual, variance


def estimator_bytes(estimator: Estimator, notes: dict[str, Any] | None = None) -> bytes:
    """Content of an estimator's file (.npz), with notes, such as validation errors, in its record."""
    kept = ("wires", "joints", "robot", "logs", "sweeps", "kernel", "limit")
    record = {"format": FORMAT, "exodrake": __version__, "units": UNITS, "notes": notes or {}}
    record |= {name: getattr(estimator, name) for name in kept}
    arrays = estimator.weights._asdict()
    if model := estimator.strokes:
        rows = model.rows
        arrays |= zip(STROKES, (rows.inputs, rows.angle, rows.sweep, rows.time, model.theta), strict=True)
    stream = io.BytesIO()
    np.savez(stream, record=np.array(json.dumps(record)), **arrays)
    return stream.getvalue()


def load(path: str | Path, robot: str | None = None) -> Estimator:
    """Read an estimator; with the signature of a robot, one that carries it. InputError for anything else."""
    arrays = read_arrays(read_bytes(path), str(path))
    try:
        record = json.loads(str(arrays.pop("record")))
    except (ValueError, KeyError, RecursionError) as error:
        raise InputError(f"{path}: not an estimator file ({error})") from None
    if not isinstance(record, dict) or (record.get("format"), record.get("units")) != (FORMAT, UNITS):
        raise InputError(f"{path}: not an estimator file of this version ({FORMAT!r}, units {UNITS})")
    if robot is not None and record.get("robot") != robot:
        known = str(record.get("robot") or "unknown")[:12]
        raise InputError(f"{path}: trained for another robot (signature {known}, this robot's is {robot[:12]})")
    try:
        wires, joints, logs = (tuple(record[name]) for name in ("wires", "joints", "logs"))
        inputs, points, strokes = 2 * len(wires), len(arrays["alpha"]), None
        shapes = {
            "center": (inputs,), "rotation": (inputs, inputs), "points": (inputs, points), "shrink": (inputs,),
            "variances": (3,), "alpha": (points, len(joints)), "factor": (points * (points + 1) // 2,),
            "offset": (len(joints),), "gain": (len(joints),), "spread": (len(joints),),
        }  # fmt: skip
        if STROKES[0] in arrays:  # not in files of earlier versions
            rows = len(arrays["strokes_sweep"])
            wide, theta = (rows, len(wires)), sweep_kernel(len(wires)).theta.shape
            shapes |= zip(STROKES, (wide, wide, (rows,), (rows,), theta), strict=True)
        found = {name: np.ascontiguousarray(arrays[name], dtype=float) for name in shapes}
        for name, array in found.items():  # compiled code does not check the shapes
            if array.shape != shapes[name] or not array.size or not np.isfinite(array).all():
                raise ValueError(f"{name} has shape {array.shape}, wanted {shapes[name]}, all finite")
        if STROKES[0] in arrays:
            tension, stroke, sweep, time, theta = (found.pop(name) for name in STROKES)
            strokes = StrokeModel(Sweeps(tension, stroke, sweep.astype(int), time, wires, wires), theta)
        return Estimator(
            wires, joints, Weights(**found), float(record["limit"]), record["robot"], logs, int(record["sweeps"]),
            record["kernel"], strokes,
        )  # fmt: skip
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged estimator file ({error})") from None


def quick_estimator(robot: Robot, cache: Path | None = None) -> Estimator:
    """An estimator of simulated sweeps of a robot without effects, or the one kept in a file for that robot."""
    if cache is not None and cache.is_file():
        with suppress(InputError):
            return load(cache, robot_digest(robot))
    training = sweeps_from_logs([simulate(robot, sweeps(robot), seed=0)])
    return replace(fit(training, QUICK_POINTS), robot=robot_digest(robot))
