"""Free inputs: evidence that a block has an input of unknown course, at a point where an effect may act.

    r_t = J_t x + F_t c_t + e_t         x ~ N(0, P^-1)     c_tj ~ N(0, s_j^2)     e ~ N(0, v_kind)

r: whitened prediction errors in a cell of time t. x: nominal parameters. F: responses to an effect, or to a change of a
nominal parameter, in each channel j. c: its amplitudes, free in each cell. So no law is needed, only the pattern that
an input at that point leaves in the signals (unknown inputs; Frank, Automatica 26(3), 1990). x and c are eliminated in
closed form. s and v are those of the largest evidence (MacKay, Neural Computation 4(3), 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.likelihood import SAMPLE, Likelihood
from exodrake.diagnosis.linearise import Linearisation
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.trial import Trial

CELL = 2  # samples with one amplitude, 0.2 s: shorter than a motion takes to turn round; assumed
ROUNDS = 15  # of the fixed point
LARGEST = 1.0  # relative change of a nominal parameter that stands for a fault; assumed
WHOLE = ("",)  # channels of an input of the whole robot
LEAST = 10  # cells of a case whose inputs are compared
SMALL = 1e-2  # response [noise_std] that counts as none


@dataclass(frozen=True, eq=False)
class Input:
    """A free input.

    Attributes:
        name: id of an effect, or name of a nominal parameter.
        channels: that have one each; one without a name for the whole robot.
        responses: (channels, samples) to an amplitude of 1, of the last view.
        largest: (channels,) plausible amplitude.
    """

    name: str
    channels: tuple[str, ...]
    responses: np.ndarray
    largest: np.ndarray


@dataclass(frozen=True, eq=False)
class Course:
    """A fitted free input.

    Attributes:
        name: name of the input.
        channels: channels that respond.
        gain: log evidence above that without an input.
        share: share of the residual's variance that it takes up by that.
        size: (channels,) root mean square amplitudes.
        count: (channels,) number of amplitudes that the logs determine.
    """

    name: str
    channels: tuple[str, ...]
    gain: float
    share: float
    size: np.ndarray
    count: np.ndarray

    @property
    def block(self) -> str:
        """Block in which it acts."""
        return self.name.split(".")[0]


def inputs_of(likelihood: Likelihood, lin: Linearisation, e: Explanation) -> list[Input]:
    """Free inputs at every effect of a linearisation, and at every nominal parameter of a block with effects."""
    responses, found = likelihood.split(lin.directions)[-1], {}
    for probe in lin.probes:  # an effect with channels has its directions by channel first
        if probe.effect not in found or found[probe.effect].channels == WHOLE:
            channels = tuple((probe.parameters[i].channels or WHOLE)[0] for i in probe.scaled) or WHOLE
            largest = np.maximum(np.abs(probe.low), np.abs(probe.high))
            found[probe.effect] = Input(probe.effect, channels, responses[probe.rows], largest)
    return [*found.values(), *nominal_inputs(likelihood, e)]


def nominal_inputs(likelihood: Likelihood, e: Explanation) -> list[Input]:
    """Free inputs at nominal parameters, those of all channels together."""
    machine, jacobian = likelihood.robot.machine, likelihood.split(e.jacobian)[-1]
    blocks, known = {effect.block for effect in machine.effects}, {*machine.axes.tendons, *machine.axes.joints}
    groups: dict[str, dict[str, int]] = {}
    for i, p in enumerate(e.parameters[: e.nominal]):
        name = p.name.split()[0]
        stem, _, last = name.rpartition(".")
        if name.split(".")[0] in blocks:
            groups.setdefault(stem if last in known else name, {})[last if last in known else ""] = i
    return [
        Input(f"{name}, nominal", tuple(rows), jacobian[list(rows.values())], np.full(len(rows), LARGEST))
        for name, rows in groups.items()
    ]


class Cells:
    """The logs of the last view in cells of time, with the nominal parameters eliminated.

    Args:
        offset: (samples,) residual with nominal parameters at 0, as the Jacobian expects it.
        jacobian: (nominal, samples) its derivatives. prior_std: (nominal,).
        trials: logs. kinds: of their columns; each has a residual variance of its own. frames: that make a sample.
    """

    def __init__(
        self, offset: np.ndarray, jacobian: np.ndarray, prior_std: np.ndarray, trials: Sequence[Trial],
        kinds: Sequence[str], frames: int,
    ) -> None:  # fmt: skip
        self.trials, self.precision, self.frames = trials, prior_std**-2.0, frames
        names = list(dict.fromkeys(kinds))
        kind = np.tile([names.index(k) for k in kinds], CELL)
        self.kinds = [np.flatnonzero(kind == k) for k in range(len(names))]
        self.offset = self.cut(offset[None])[:, :, 0]
        whole = self.cut(jacobian)
        self.jacobian = [whole[:, at] for at in self.kinds]
        self.offsets = [self.offset[:, at] for at in self.kinds]
        self.count = np.array([y.size for y in self.offsets])
        flat = [j.reshape(-1, len(prior_std)) for j in self.jacobian]
        self.normal = np.array([j.T @ j for j in flat])
        self.pull = np.array([j.T @ y.ravel() for j, y in zip(flat, self.offsets, strict=True)])
        self.squares = np.array([float(np.sum(y**2)) for y in self.offsets])
        self.variance = np.maximum(self.squares / self.count, 1.0)
        none = self.products(np.zeros((*self.offset.shape, 0)))
        self.alone, self.variance, *_ = self.fitted(none, np.zeros(0), np.zeros(0))

    def cut(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n, samples) as means over `SAMPLE`, in units of their noise (cells, samples of a cell, n)."""
        parts, ends = [], np.cumsum([t.measured.size for t in self.trials])[:-1]
        for part, trial in zip(np.split(rows, ends, axis=1), self.trials, strict=True):
            columns = trial.measured.shape[1]
            cells = len(trial.measured) // (CELL * self.frames)
            used = part.reshape(len(rows), -1, columns)[:, : cells * CELL * self.frames]
            means = used.reshape(len(rows), cells * CELL, self.frames, columns).sum(axis=2) / np.sqrt(self.frames)
            parts.append(means.reshape(len(rows), cells, CELL * columns))
        return np.concatenate(parts, axis=1, dtype=float).transpose(1, 2, 0)

    def course(self, given: Input) -> Course | None:
        """A free input fitted; None for one that leaves nothing in the logs."""
        responses = self.cut(given.responses)
        strength = np.sqrt(np.mean(np.sum(responses**2, axis=1), axis=0))
        on = np.flatnonzero(np.max(np.abs(responses), axis=(0, 1), initial=0.0) > SMALL)
        if not len(on):
            return None
        found = self.products(responses[:, :, on] / strength[on])
        value, _, scale, count = self.fitted(found, self.first_scale(found), given.largest[on] * strength[on])
        gain = max(value - self.alone, 0.0)
        share = 1.0 - float(np.exp(-2.0 * gain / np.sum(self.count)))
        return Course(given.name, tuple(given.channels[i] for i in on), gain, share, scale / strength[on], count)

    def products(self, responses: np.ndarray) -> Products:
        """Products of responses (cells, samples, channels) with each other, the Jacobian and the offset."""
        own = [np.ascontiguousarray(responses[:, at].transpose(0, 2, 1)) for at in self.kinds]
        return Products(
            np.array([f @ f.transpose(0, 2, 1) for f in own]),
            np.array([f @ j for f, j in zip(own, self.jacobian, strict=True)]),
            np.array([(f @ y[:, :, None])[:, :, 0] for f, y in zip(own, self.offsets, strict=True)]),
        )

    def first_scale(self, found: Products) -> np.ndarray:
        """Scales (channels,) as each channel alone would need them."""
        gram, slope = (np.tensordot(1.0 / self.variance, p, 1) for p in (found.gram, found.slope))
        own = np.maximum(np.einsum("taa->ta", gram), 1e-9)
        return np.sqrt(np.sum(slope**2 / own, axis=0) / np.sum(own, axis=0))

    def fitted(
        self, found: Products, scale: np.ndarray, largest: np.ndarray
    ) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """The largest log evidence, with the variances (kinds,), scales and determined amplitudes (channels,)."""
        variance, best = np.maximum(0.5 * self.variance, 1.0), (-np.inf, self.variance, scale, scale)
        cells = len(self.offset)
        for _ in range(ROUNDS):
            scale = np.clip(scale, 1e-6, np.maximum(largest, 1e-6))
            value, squares, used, amplitudes, own = self.solved(found, variance, scale)
            count = np.maximum(cells - np.einsum("taa->a", own) / scale**2, 1e-3)
            if value > best[0]:
                best = value, variance, scale, count
            variance = np.maximum(squares / np.maximum(self.count - used, 0.05 * self.count), 1.0)
            scale = np.sqrt(np.sum(amplitudes**2, axis=0) / count)
        return best

    def solved(
        self, found: Products, variance: np.ndarray, scale: np.ndarray
    ) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """One solution at given variances and scales.

        Returns:
            log evidence, squares that are left and parameters used (kinds,), amplitudes (cells, channels) and their
            covariance (cells, channels, channels).
        """
        weight, n = 1.0 / variance, len(self.precision)
        normal, pull = np.tensordot(weight, self.normal, 1) + np.diag(self.precision), weight @ self.pull
        gram = np.tensordot(weight, found.gram, 1) + np.diag(scale**-2.0)
        cross, slope = np.tensordot(weight, found.cross, 1), np.tensordot(weight, found.slope, 1)
        inverse = np.linalg.inv(gram)
        solved = inverse @ cross
        flat = solved.reshape(-1, n)
        schur = normal - cross.reshape(-1, n).T @ flat
        covariance = np.linalg.inv(0.5 * (schur + schur.T))
        x = -covariance @ (pull - flat.T @ slope.ravel())
        c = -(inverse @ slope[:, :, None])[:, :, 0] - solved @ x
        mixed = solved @ covariance
        own = inverse + mixed @ solved.transpose(0, 2, 1)
        squares = self.squares + 2.0 * self.pull @ x + np.einsum("i,kij,j->k", x, self.normal, x)
        squares += np.einsum("ta,ktab,tb->k", c, found.gram, c) + 2.0 * np.einsum("kta,ta->k", found.slope, c)
        squares += 2.0 * np.einsum("ta,kta->k", c, found.cross @ x)
        used = np.einsum("ij,kij->k", covariance, self.normal) + np.einsum("tab,ktab->k", own, found.gram)
        used = weight * (used - 2.0 * np.einsum("tap,ktap->k", mixed, found.cross))
        volume = np.linalg.slogdet(schur)[1] + float(np.sum(np.linalg.slogdet(gram)[1]))
        volume += 2.0 * len(self.offset) * float(np.sum(np.log(scale))) - float(np.sum(np.log(self.precision)))
        priors = float(np.sum(self.precision * x**2) + np.sum((c / scale) ** 2))
        value = -0.5 * (float(self.count @ np.log(variance) + weight @ squares) + priors + volume)
        return value, squares, used, c, own


@dataclass(frozen=True, eq=False)
class Products:
    """Products of the responses for each kind of column in each cell of time.

    Attributes:
        gram: (kinds, cells, channels, channels) with each other.
        cross: (kinds, cells, channels, nominal) with the nominal Jacobian.
        slope: (kinds, cells, channels) with the offset.
    """

    gram: np.ndarray
    cross: np.ndarray
    slope: np.ndarray


def free_courses(likelihood: Likelihood, lin: Linearisation, e: Explanation) -> list[Course]:
    """Free inputs that raise the evidence of the logs, best first.

    Args:
        likelihood: views of the case.
        lin: linearisation beside an explanation without effects.
        e: the explanation.
    """
    problem = likelihood.views[-1].problem
    offset, jacobian = (likelihood.split(rows)[-1] for rows in (e.residual - e.x @ e.jacobian, e.jacobian))
    frames = max(round(SAMPLE / problem.robot.machine.frame), 1)
    if sum(len(trial.measured) // (CELL * frames) for trial in problem.fit) < LEAST:
        return []
    cells = Cells(offset, jacobian, e.prior_std, problem.fit, problem.kinds, frames)
    found = [cells.course(given) for given in inputs_of(likelihood, lin, e)]
    return sorted((c for c in found if c is not None and c.gain > 0.0), key=lambda c: -c.gain)
