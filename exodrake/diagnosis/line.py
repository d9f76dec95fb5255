"""A line in the spectrum of what is left: a tremor, whose wandering phase no simulation repeats, so that it is seen
rather than fitted.

It is one if a narrow band holds most of what is left above the floor and holds alike in every log, whatever the
reference does. The power that each joint's torque would leave in each signal, by simulation, then tells the joint and
the torque.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.candidates import Hypothesis, hypothesis
from exodrake.diagnosis.fit import Fitter, Point
from exodrake.diagnosis.intervals import LAW, MINOR, Z90
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import Interval, NamedEffect

TREMOR = "finger.tremor"
WINDOW = 10.0  # s, of one spectrum: resolves 0.1 Hz
LOWEST, HIGHEST = 1.5, 15.0  # Hz, where a tremor lies: 6-12 Hz, displacement from 1-3.5 Hz (physics.md 4.D)
HALF, ASIDE = 0.6, 1.8  # Hz, half the band of a line, and the end of its neighbourhood; the phase wanders: assumed
LEAST = 0.02  # of the floor: less than this is nothing left
MOST = 0.6  # of what is left above the floor
ALIKE = 0.5  # of the mean over logs that the weakest log's line must reach


@dataclass(frozen=True, eq=False)
class Line:
    """frequency [Hz], power (columns,) [floor^2], its share of what is left above the floor, and the weakest log
    against the mean.
    """

    frequency: float
    power: np.ndarray
    share: float
    steady: float

    @property
    def certain(self) -> bool:
        """Whether it is a tremor's."""
        return self.share > MOST and self.steady > ALIKE


def find(problem: Problem, logs: list[np.ndarray]) -> Line:
    """The strongest line in residuals (n, columns) [floor] of several logs."""
    spectra = [spectrum(problem, log) for log in logs]
    weights = np.array([len(log) for log in logs], float) / sum(len(log) for log in logs)
    frequency, whole = spectra[0][0], np.tensordot(weights, np.array([s[1] for s in spectra]), axes=1)
    sought = (frequency >= LOWEST) & (frequency <= min(HIGHEST, frequency[-1]))
    peak = float(frequency[sought][np.argmax(whole.sum(axis=1)[sought])])
    powers = np.array([in_band(frequency, s[1], peak) for s in spectra])
    power = weights @ powers
    left = sum(w * float(np.mean(np.sum(log**2, axis=1))) for w, log in zip(weights, logs, strict=True))
    each = powers.sum(axis=1)
    steady = float(each.min() / max(each.mean(), 1e-12))
    return Line(peak, power, float(power.sum() / max(left - len(power), LEAST * len(power))), steady)


def spectrum(problem: Problem, log: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (f,) [Hz] and power densities (f, columns) [floor^2/Hz]."""
    from scipy.signal import welch

    rate = 1.0 / problem.robot.machine.frame
    return welch(log, rate, nperseg=min(len(log), round(WINDOW * rate)), axis=0)


def in_band(frequency: np.ndarray, density: np.ndarray, peak: float) -> np.ndarray:
    """Power of the band around a line (columns,) above its neighbourhood."""
    away = np.abs(frequency - peak)
    band, beside = away <= HALF, (away > HALF) & (away < ASIDE)
    ground = np.median(density[beside], axis=0) if beside.any() else 0.0
    return np.maximum((density[band] - ground).sum(axis=0) * (frequency[1] - frequency[0]), 0.0)


def tremor(fitter: Fitter, point: Point, line: Line) -> tuple[Hypothesis, np.ndarray]:
    """The point's hypothesis with a tremor, and its u: torques by non-negative least squares on the powers."""
    from scipy.optimize import nnls

    problem = fitter.problem
    extra = hypothesis(problem.robot.machine, problem.robot.machine.effect(TREMOR))
    both, u = point.hypothesis.joined(extra), extra.start
    joints = [i for i, knob in enumerate(extra.knobs) if knob.first]
    u[[i for i in range(len(u)) if i not in joints]] = extra.knobs[-1].at(line.frequency)
    trial = problem.fit[0]
    rows = [fitter.values(point.hypothesis, point.u, point.x)]
    for joint in joints:
        alone = u.copy()
        alone[[i for i in joints if i != joint]] = 0.0
        rows.append(fitter.values(both, np.concatenate([point.u, alone]), point.x))
    logs = problem.predict(np.array(rows), trial) / problem.floor
    unit = [in_band(*spectrum(problem, log - logs[0]), line.frequency) for log in logs[1:]]
    scale = np.sqrt(line.power + 1e-3)  # a power is known the better the smaller it is
    shares, _ = nnls(np.array(unit).T / scale[:, None], line.power / scale)
    u[joints] *= np.sqrt(shares)
    return both, np.concatenate([point.u, u])


def named(point: Point, line: Line, joints: tuple[str, ...]) -> NamedEffect:
    """The tremor of a point, its joints those with more than a minor part of the strongest one's torque."""
    knobs = [(k, u) for k, u in zip(point.hypothesis.knobs, point.u, strict=True) if k.effect == TREMOR and k.first]
    strongest = max(u for _, u in knobs)
    torques = {k.lanes[0]: torque(u) for k, u in knobs if u > MINOR * strongest}
    mean = float(np.mean([i.value for i in torques.values()]))
    half = 0.5 / WINDOW
    frequency = Interval(line.frequency, line.frequency - half, line.frequency + half, "Hz")
    sits = tuple(joint for joint in joints if joint in torques)
    return NamedEffect(TREMOR, (), sits, {"torque": torque(mean), "frequency": frequency}, {"torque": torques}, 1.0)


def torque(value: float) -> Interval:
    """A torque [N m] with its 90 % interval: the wave's form is not known."""
    return Interval(value, value * (1.0 - Z90 * LAW), value * (1.0 + Z90 * LAW), "N m")
