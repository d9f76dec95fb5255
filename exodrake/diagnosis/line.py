"""A line in the spectrum of what is left: a tremor, whose wandering phase no simulation repeats, so that it is seen
rather than fitted.

It is one if a narrow band stands out from its neighbourhood, alike in every log, whatever the reference does. Other
causes are then sought without its band. The power that each joint's torque would leave in each signal, by simulation,
tells the joint and the torque.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.filters import Bands
from exodrake.diagnosis.fit import Point
from exodrake.diagnosis.hypothesis import Hypothesis, hypothesis
from exodrake.diagnosis.intervals import LAW, MINOR, Z90
from exodrake.diagnosis.problem import Problem, by_trial
from exodrake.diagnosis.result import Interval, NamedEffect

TREMOR = "finger.tremor"
WINDOW = 10.0  # s, of one spectrum: resolves 0.1 Hz
LOWEST, HIGHEST = 1.5, 15.0  # Hz, where a tremor lies: 6-12 Hz, displacement from 1-3.5 Hz (physics.md 4.D)
HALF, ASIDE = 0.6, 1.8  # Hz, half the band of a line, and the end of its neighbourhood; the phase wanders: assumed
STANDS_OUT = 8.0  # times the ground beside it, in every log: noise reaches 1.3, a mount that rings 7
ALIKE = 0.5  # of the mean over logs that the weakest log's line must reach
NOTCHED = 1.2  # Hz, half the band left out when other causes are sought: a phase that wanders has long wings
SLOWEST = 0.3  # Hz, that a band begins at: slower motion is the reference's
LEAKAGE = (
    0.1  # share of its power beyond that band, at most: a phase that wanders half a turn in 10 s leaves 0.04 there
)
OVERTONES = 2  # the line itself and its octave: a muscle's pull is no pure sine


@dataclass(frozen=True, eq=False)
class Line:
    """frequency [Hz], power (columns,) [noise variance], density in the band over that beside it in the log where it
    stands out least, and the weakest log's power against the mean.
    """

    frequency: float
    power: np.ndarray
    prominence: float
    steady: float

    @property
    def certain(self) -> bool:
        """Whether it is a tremor's."""
        return self.prominence > STANDS_OUT and self.steady > ALIKE

    def bands(self, nyquist: float) -> Bands:
        """Frequencies [Hz] that it and its overtone hold, up to the highest that a log shows."""
        centres = (k * self.frequency for k in range(1, OVERTONES + 1))
        return tuple((max(f - NOTCHED, SLOWEST), f + NOTCHED) for f in centres if f + ASIDE < nyquist)


def find(problem: Problem, logs: list[np.ndarray]) -> Line:
    """The line that stands out most in residuals (n, columns) [noise_std] of several logs."""
    spectra = [spectrum(problem, log) for log in logs]
    frequency, sums = spectra[0][0], np.array([density.sum(axis=1) for _, density in spectra])
    sought = frequency[(frequency >= LOWEST) & (frequency <= min(HIGHEST, frequency[-1] - ASIDE))]
    prominences = [np.min(prominence(frequency, sums, centre)) for centre in sought]
    near = np.abs(frequency - sought[int(np.argmax(prominences))]) <= HALF
    peak = float(frequency[near][np.argmax(sums.sum(axis=0)[near])])
    weights = np.array([len(log) for log in logs], float) / sum(len(log) for log in logs)
    powers = np.array([in_band(frequency, density, peak) for _, density in spectra])
    each = powers.sum(axis=1)
    steady = float(each.min() / max(each.mean(), 1e-12))
    return Line(peak, weights @ powers, float(np.max(prominences)), steady)


def prominence(frequency: np.ndarray, sums: np.ndarray, centre: float) -> np.ndarray:
    """Density in a band over that beside it (logs,), from densities (logs, f)."""
    band, beside = around(frequency, centre)
    return sums[:, band].mean(axis=1) / np.maximum(np.median(sums[:, beside], axis=1), 1e-12)


def around(frequency: np.ndarray, centre: float) -> tuple[np.ndarray, np.ndarray]:
    """Which frequencies (f,) are in the band of a line, and which beside it."""
    away = np.abs(frequency - centre)
    return away <= HALF, (away > HALF) & (away < ASIDE)


def spectrum(problem: Problem, log: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (f,) [Hz] and power densities (f, columns) [noise variance/Hz]."""
    from scipy.signal import welch

    rate = 1.0 / problem.robot.machine.frame
    return welch(log, rate, nperseg=min(len(log), round(WINDOW * rate)), axis=0)


def in_band(frequency: np.ndarray, density: np.ndarray, peak: float) -> np.ndarray:
    """Power of the band around a line (columns,) above its neighbourhood."""
    band, beside = around(frequency, peak)
    ground = np.median(density[beside], axis=0) if beside.any() else 0.0
    return np.maximum((density[band] - ground).sum(axis=0) * (frequency[1] - frequency[0]), 0.0)


def seen(problem: Problem, point: Point) -> Line | None:
    """The line of a tremor in what a fitted point leaves, if there is one and a tremor is tried."""
    if TREMOR not in problem.tried:
        return None
    line = find(problem, by_trial(point.residual, problem.fit))
    return line if line.certain else None


@dataclass(frozen=True, eq=False)
class Tremor:
    """A tremor as an effect: its line, its hypothesis and u."""

    line: Line
    hypothesis: Hypothesis
    u: np.ndarray


def tremor(problem: Problem, values: np.ndarray, line: Line) -> Tremor:
    """The tremor behind a line, in the robot with the flat numbers `values`: torques by non-negative least squares on
    the powers.
    """
    from scipy.optimize import nnls

    extra = hypothesis(problem.robot.machine, problem.robot.machine.effect(TREMOR))
    u = extra.start
    joints = [i for i, coordinate in enumerate(extra.coordinates) if coordinate.first]
    u[[i for i in range(len(u)) if i not in joints]] = extra.coordinates[-1].at(line.frequency)
    rows = [values]
    for joint in joints:
        alone = u.copy()
        alone[[i for i in joints if i != joint]] = 0.0
        rows.append(extra.apply(values, alone))
    logs = problem.predict(np.array(rows), problem.fit[0]) / problem.noise_std
    unit = [in_band(*spectrum(problem, log - logs[0]), line.frequency) for log in logs[1:]]
    scale = np.sqrt(line.power + 1e-3)  # a power is known the better the smaller it is
    shares, _ = nnls(np.array(unit).T / scale[:, None], line.power / scale)
    u[joints] *= np.sqrt(shares)
    return Tremor(line, extra, u)


def named(found: Tremor, joints: tuple[str, ...]) -> NamedEffect:
    """A tremor, its joints those with more than a minor part of the strongest one's torque."""
    line, coordinates = (
        found.line,
        [(k, u) for k, u in zip(found.hypothesis.coordinates, found.u, strict=True) if k.first],
    )
    strongest = max(u for _, u in coordinates)
    torques = {k.channels[0]: torque(u) for k, u in coordinates if u > MINOR * strongest}
    mean = float(np.mean([i.value for i in torques.values()]))
    half = 0.5 / WINDOW
    frequency = Interval(line.frequency, line.frequency - half, line.frequency + half, "Hz")
    sits = tuple(joint for joint in joints if joint in torques)
    return NamedEffect(TREMOR, (), sits, {"torque": torque(mean), "frequency": frequency}, {"torque": torques}, 1.0)


def torque(value: float) -> Interval:
    """A torque [N m] with its 90 % interval: the wave's form is not known."""
    return Interval(value, value * (1.0 - Z90 * LAW), value * (1.0 + Z90 * LAW), "N m")
