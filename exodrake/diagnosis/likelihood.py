"""The regression: whitened residuals of candidate robots on the fit logs, in closed loop and as prediction error.

    r(x) = [ W1 (y - f1(x)) ; W2 (y - f2(x)) ]          cost = 1/2 |r|^2 + 1/2 sum (x_i / prior_std_i)^2

f1 simulates the whole loop on the references (output error). f2 takes the logged inputs and corrects its state by the
logged outputs (output injection, `Machine.observer`), so that an error of one part does not go round the loop
(prediction error; Ljung, System Identification, 1999, ch. 3 and 7). A machine without an observer has f1 alone. Each
view is divided in the cost by the distance of the best robot so far from its noise, so that both views have weight.

W makes noise of the measured spectrum white. The noise of a residual differs from that of the sensor: it passes through
the loop, and encoder steps colour it. It is the difference of two simulated runs of the retuned robot, with and without
noise and quantisation. An autoregressive model is fitted to each column by the Yule-Walker equations (Kay, Modern
Spectral Estimation, 1988, ch. 7):

    e[t] + a1 e[t-1] + ... + ap e[t-p] = s w[t]          w white, unit variance
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import Lock

import numpy as np
from numba import njit

from exodrake.core.parallel import side_by_side
from exodrake.diagnosis.parameter import apply, nominal_parameters
from exodrake.diagnosis.problem import Problem, Trial, by_trial
from exodrake.model.robot import Robot

# s of a log that count as one sample against the tolerances: a model's error repeats in every motion. With 0.66 s, 90 %
# intervals of nominal parameters of 24 healthy robots of the reference simulator covered 90 %, with one frame 41 %
CORRELATION = 0.66
# s that count as one sample where a law is free: its error goes on longer than noise; assumed
SAMPLE = 0.1
# s, longer than the loop's memory: stretches count as independent; between so many of them: assumed
STRETCH, LEAST, MOST = 2.0, 8, 200
COUNTING = Lock()  # of the simulated time, by fits side by side
NOISE_RUNS = 8  # simulated runs with noise; draws are made from them
# of the tolerances, by which the robot of each run differs: a signal at rest is then rounded elsewhere; assumed
NOISE_MOVES = 0.2
ORDER = 12  # frames of memory, 0.24 s at 50 Hz: longer than a bus round trip and the encoder's steps in motion; assumed
REGULARISATION = 1e-4  # of the variance, added to it: an encoder at rest has a singular spectrum


@dataclass(frozen=True, eq=False)
class Whitening:
    """Autoregressive noise model: `coefficients` (columns, ORDER + 1), `noise_std` (columns,) of the innovations."""

    coefficients: np.ndarray
    noise_std: np.ndarray

    def __call__(self, residuals: np.ndarray) -> np.ndarray:
        """Whitened residuals [-] of residuals (..., frames, columns)."""
        taps, out = self.coefficients.T / self.noise_std, np.empty(residuals.shape)
        convolve(residuals.reshape(-1, *residuals.shape[-2:]), taps, out.reshape(-1, *residuals.shape[-2:]))
        return out


@dataclass(frozen=True, eq=False)
class View:
    """One kind of residual."""

    problem: Problem  # trials and columns
    whitening: Whitening  # noise model
    scale: float = 1.0  # divisor of the whitened residual in the cost [-]
    squares: np.ndarray | None = None  # (runs, columns) mean squares of simulated runs with noise [noise variances]

    @property
    def samples(self) -> int:
        """Length of its residual."""
        return sum(trial.measured.size for trial in self.problem.fit)


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Views of a case side by side."""

    views: tuple[View, ...]  # kinds of residual
    # time simulated so far, by stage [s]; likelihoods of one case share it
    simulated: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    stage: str = ""  # under which further simulations are counted
    memory: float = 1.0  # frames that count as one

    @property
    def robot(self) -> Robot:
        """The nominal robot of the case."""
        return self.views[0].problem.robot

    @property
    def samples(self) -> int:
        """Length of the residual."""
        return sum(view.samples for view in self.views)

    def residual(self, rows: np.ndarray) -> np.ndarray:
        """Whitened residuals (rows, samples) [noise_std] of flat parameter vectors (rows, parameters)."""
        with COUNTING:
            self.simulated[self.stage] += len(rows) * sum(duration(view.problem) for view in self.views)
        out = np.empty((len(rows), self.samples))
        parts = [(v.problem, v.whitening, part) for v, part in zip(self.views, self.split(out), strict=True)]
        side_by_side([task for p, whitening, part in parts for task in p.tasks(rows, p.fit, part, whitening)])
        return out

    def derivatives(self, rows: np.ndarray, base: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Difference quotients (rows, samples), float32, of robots that are `steps` (rows,) off the one of `base`."""
        if not len(rows):
            return np.zeros((0, len(base)), dtype=np.float32)
        return ((self.residual(rows) - base) / steps[:, None]).astype(np.float32)

    def split(self, residual: np.ndarray) -> list[np.ndarray]:
        """A residual (..., samples) cut into one for each view."""
        return np.split(residual, np.cumsum([view.samples for view in self.views])[:-1], axis=-1)

    def columns_of_joints(self) -> list[tuple[np.ndarray, ...]]:
        """Masks (columns,) of each view's columns, of each measured joint of several that are separate."""
        if not self.robot.machine.separate:
            return []
        columns = [view.problem.columns for view in self.views]
        channels = {column.rsplit("_", 1)[1] for some in columns for column in some}
        joints = [j for j in self.robot.machine.axes.joints if j in channels and len(channels) > 1]
        return [tuple(np.array([c.endswith(f"_{joint}") for c in some]) for some in columns) for joint in joints]

    def samples_of_joints(self) -> list[np.ndarray]:
        """Masks (samples,) of the residual's samples of the joints of `columns_of_joints`."""
        found = []
        for own in self.columns_of_joints():
            parts = zip(self.views, own, strict=True)
            found.append(np.concatenate([np.tile(o, len(t.measured)) for view, o in parts for t in view.problem.fit]))
        return found

    def any_by_joint(self, seen: np.ndarray) -> np.ndarray:
        """Whether any of `seen` (columns,) holds, by joint (joints,) where these are separate, else of all (1,)."""
        return np.array([seen[own[0]].any() for own in self.columns_of_joints()] or [seen.any()])

    def chi2(self, residual: np.ndarray) -> np.ndarray:
        """Reduced chi-square (views,) of a residual (samples,)."""
        return np.array([float(np.mean(part**2)) for part in self.split(residual)])

    @cached_property
    def cells(self) -> list[list[list[np.ndarray]]]:
        """Indices of the samples of each log, in each view, of each joint where joints are separate, else of all."""
        joints, found = self.samples_of_joints() or [np.full(self.samples, True)], defaultdict[int, list](list)
        for _, k, some in self.blocks:
            found[k].append([some.start + np.flatnonzero(own[some]) for own in joints])
        return list(found.values())

    @cached_property
    def samples_by_log(self) -> np.ndarray:
        """Number of samples (logs, views, joints) of `cells`."""
        return np.array([[[len(cell) for cell in view] for view in log] for log in self.cells])

    def chi2_by_log(self, residual: np.ndarray) -> np.ndarray:
        """Mean squares (logs, views, joints) of `cells` of a residual (samples,)."""
        return np.array([[[np.mean(residual[cell] ** 2) for cell in view] for view in log] for log in self.cells])

    def mean_log(self, residual: np.ndarray) -> float:
        """Mean logarithm of the reduced chi-squares of all views of a residual (samples,), above the noise."""
        return float(np.mean(np.log(np.maximum(self.chi2(residual), 1.0))))

    @cached_property
    def weights(self) -> np.ndarray:
        """Weight of each sample in the cost (samples,)."""
        return np.concatenate([np.full(v.samples, 1.0 / v.scale, dtype=np.float32) for v in self.views])

    def cost(self, residual: np.ndarray, x: np.ndarray, prior_std: np.ndarray) -> float:
        """Half the sum of squares of the weighted residual (samples,) and of x in units of its prior."""
        weighted = residual * self.weights
        return 0.5 * float(weighted @ weighted) + 0.5 * float(np.sum((x / prior_std) ** 2))

    def on(self, problem: Problem) -> Likelihood:
        """The likelihood of more or less of the same logs."""
        views = zip(self.views, with_prediction(problem), strict=True)
        return replace(self, views=tuple(replace(view, problem=of_view) for view, of_view in views))

    def for_stage(self, stage: str) -> Likelihood:
        """The likelihood whose simulations count under another stage."""
        return replace(self, stage=stage)

    @property
    def blocks(self) -> list[tuple[int, int, slice]]:
        """View, log and samples of each log in each view."""
        found, at = [], 0
        for v, view in enumerate(self.views):
            for k, trial in enumerate(view.problem.fit):
                found.append((v, k, slice(at, at := at + trial.measured.size)))
        return found

    @property
    def stretches(self) -> list[tuple[int, int, slice]]:
        """View, log and samples of each stretch of each log in each view."""
        problem, found = self.views[0].problem, []
        length = stretch_length(sum(len(trial.measured) for trial in problem.fit), problem.robot.machine.frame)
        for v, k, log in self.blocks:
            width = length * len(self.views[v].problem.columns)
            found += [(v, k, slice(a, min(a + width, log.stop))) for a in range(log.start, log.stop, width)]
        return found

    def scaled_to(self, residual: np.ndarray) -> Likelihood:
        """The likelihood with each view in units of what a residual (samples,) leaves, noise at least."""
        scales = np.sqrt(np.maximum(self.chi2(residual), 1.0) * self.memory)
        views = tuple(replace(view, scale=float(s)) for view, s in zip(self.views, scales, strict=True))
        return replace(self, views=views)

    def with_memory(self, residual: np.ndarray) -> Likelihood:
        """The likelihood in which as many samples count as one as a residual (samples,) is correlated over.

        Squares of its autocorrelation are summed, since evidence rests on sums of squares (Bayley & Hammersley 1946),
        up to the longest time over which a model's error repeats.
        """
        most = int(longest(self.views[0].problem))
        sums = np.zeros(most + 1)
        for view, part in zip(self.views, self.split(residual), strict=True):
            for log in by_trial(part, view.problem.fit):
                for lag in range(min(most, len(log) - 1) + 1):
                    sums[lag] += float(np.sum(log[lag:] * log[: len(log) - lag]))
        rho = sums / max(sums[0], 1e-300)
        return replace(self, memory=float(np.clip(1.0 + 2.0 * np.sum(rho[1:] ** 2), 1.0, most)))


def output_error(problem: Problem, stage: str = "") -> Likelihood:
    """The likelihood of a case in closed loop alone, in units of the sensors' noise, which counts as white."""
    columns = len(problem.columns)
    return Likelihood(
        (View(problem, Whitening(np.eye(1, ORDER + 1).repeat(columns, 0), np.ones(columns))),),
        stage=stage,
        memory=longest(problem),
    )


def stretch_length(frames: int, period: float) -> int:
    """Frames of the stretches that so many frames of `period` [s] are cut into."""
    return max(1, min(max(round(STRETCH / period), frames // MOST), frames // LEAST))


def longest(problem: Problem) -> float:
    """Frames over which a model's error repeats at the longest."""
    return max(float(round(CORRELATION / problem.robot.machine.frame)), 1.0)


def duration(problem: Problem) -> float:
    """Time that a run of all fitted trials takes [s]."""
    return sum(len(trial.reference) for trial in problem.fit) * problem.robot.machine.frame


def make_likelihood(
    problem: Problem, values: np.ndarray, simulated: defaultdict[str, float] | None = None
) -> Likelihood:
    """The likelihood of a case with the noise of the robot `values` (parameters,), noise and rounding off in it.

    simulated: time simulated so far, by stage [s]; that of the runs with noise is added.
    """
    views, robots = with_prediction(problem), moved_a_little(problem, values)
    runs = [with_prediction(written_by(problem, robot, seed)) for seed, robot in enumerate(robots)]
    found = []
    for k, view in enumerate(views):
        written = [(run[k], robot) for run, robot in zip(runs, robots, strict=True)]
        raw = [by_trial(run.residual(robot[None], run.fit)[0], run.fit) for run, robot in written]
        whitening = fit_whitening([log for run in raw for log in run])
        squares = np.array([np.mean(np.concatenate(run) ** 2, axis=0) for run in raw])
        found.append(View(view, whitening, squares=squares))
    simulated = defaultdict(float) if simulated is None else simulated
    simulated["noise"] += NOISE_RUNS * duration(problem) * (1 + len(views))  # written, then simulated in each view
    return Likelihood(tuple(found), simulated, memory=longest(problem))


def moved_a_little(problem: Problem, values: np.ndarray) -> np.ndarray:
    """The robots (`NOISE_RUNS`, parameters) of the runs with noise, nominal parameters drawn about `values`."""
    nominal, rng = nominal_parameters(problem.robot), np.random.default_rng(0)
    draws = NOISE_MOVES * rng.standard_normal((NOISE_RUNS, len(nominal)))
    return np.array([apply(values, nominal, x) for x in draws * [p.prior_std for p in nominal]])


def with_prediction(problem: Problem) -> list[Problem]:
    """The problem in closed loop, and with output injection where its machine has an observer."""
    injected = problem.prediction_error()
    return [problem] if injected is None else [problem, injected]


def written_by(problem: Problem, values: np.ndarray, seed: int) -> Problem:
    """The problem with the logs that a robot would have written, noise, rounding and detected disturbances on."""
    machine, noisy, rng = problem.robot.machine, values.copy(), np.random.default_rng(seed)
    disturbances = [d.noise for d in problem.detected if d.noise]
    for name in (*machine.noise, *machine.resolution):
        noisy[machine.index[name]] = problem.robot.values[machine.index[name]]

    def written(k: int, trial: Trial) -> Trial:
        (measured,) = problem.predict(noisy[None], trial, seed=NOISE_RUNS * k + seed)
        measured = measured + sum(draw(problem, values, trial, rng) for draw in disturbances)
        return replace(trial, measured=np.where(np.isfinite(trial.measured), measured, np.nan))

    return replace(problem, fit=tuple(written(k, trial) for k, trial in enumerate(problem.fit)))


@njit(cache=True, nogil=True)
def convolve(rows: np.ndarray, taps: np.ndarray, out: np.ndarray) -> None:
    """Filters signals `rows` (rows, frames, columns) by taps (lags, columns) into `out`, from zero."""
    for k in range(len(rows)):
        for t in range(rows.shape[1]):
            out[k, t] = 0.0
            for lag in range(min(len(taps), t + 1)):
                for c in range(rows.shape[2]):
                    out[k, t, c] += taps[lag, c] * rows[k, t - lag, c]


def fit_whitening(noise: Sequence[np.ndarray]) -> Whitening:
    """The noise model of noise records (frames, columns) of several logs."""
    from scipy.linalg import solve_toeplitz

    coefficients, noise_std = [], []
    for j in range(noise[0].shape[1]):
        columns = [record[:, j] for record in noise]
        sums = np.sum([[c[k:] @ c[: len(c) - k] for k in range(ORDER + 1)] for c in columns], axis=0)
        covariance = sums / sum(len(record) for record in noise)
        covariance[0] = max(covariance[0] * (1.0 + REGULARISATION), 1e-12)
        prediction = solve_toeplitz(covariance[:-1], covariance[1:])
        coefficients.append(np.concatenate([[1.0], -prediction]))
        noise_std.append(np.sqrt(max(covariance[0] - prediction @ covariance[1:], 1e-8)))
    return Whitening(np.array(coefficients), np.array(noise_std))
