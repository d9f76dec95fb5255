"""Spectral peak: detection of a tremor, a narrow band alike in every log, whose wandering phase no simulation repeats.

Other causes are searched without its band. The power that each joint's torque would leave identifies the torques. The
phase phi is a random walk:

    E exp(i (phi(t + tau) - phi(t))) = exp(-rate tau / 2)          rate of the phase's variance [rad^2/s]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from exodrake.core.confidence import NORMAL_90
from exodrake.diagnosis.intervals import affected_channels
from exodrake.diagnosis.noise import Bands, outside
from exodrake.diagnosis.parameter import apply, effect_parameters
from exodrake.diagnosis.problem import Detection, Problem, Trial, by_trial
from exodrake.diagnosis.result import Interval, NamedEffect
from exodrake.diagnosis.search import name_kind
from exodrake.model.effect import SHAPE_STD, Effect

WINDOW = 10.0  # s, of one spectrum: resolves 0.1 Hz
LOWEST, HIGHEST = 1.5, 15.0  # Hz, where a tremor lies: 6-12 Hz, displacement from 1-3.5 Hz (physics.md 4.D)
HALF, ASIDE = 0.6, 1.8  # Hz, half the band of a peak, and the end of its neighbourhood; the phase wanders: assumed
PROMINENT = 8.0  # times the density beside it, in every log: noise reaches 1.3, a mount that rings 7
ALIKE = 0.5  # of the mean over logs that the weakest log's line must reach
NOTCHED = 1.2  # Hz, half the band left out when other causes are sought: the leakage of a phase that wanders
SLOWEST = 0.3  # Hz, that a band begins at: slower motion is the reference's
OVERTONES = 2  # the peak itself and its octave: a muscle's pull is no pure sine
LAG = 0.5  # s, over which the phase is seen to wander: longer than the band's filter remembers
LEAST = 0.05  # coherence after that lag, below which the phase counts as lost: assumed


class Peak(NamedTuple):
    """A spectral peak."""

    frequency: float  # centre [Hz]
    power: np.ndarray  # (columns,) in its band [noise variance]
    prominence: float  # density in the band over that beside it, in the log where it is least
    steady: float  # the weakest log's power over the mean

    @property
    def certain(self) -> bool:
        """Whether the peak is a tremor; peaks below its frequencies are movements of a wearer."""
        return self.prominence > PROMINENT and self.steady > ALIKE and self.frequency >= LOWEST


def detect(problem: Problem, effect: Effect, values: np.ndarray) -> Problem:
    """The problem without the band of a tremor, if what the retuned robot leaves has one; it is no candidate of a fit.

    values: (parameters,) flat parameters of the retuned robot [SI].
    """
    machine = problem.robot.machine
    left = by_trial(problem.residual(values[None], problem.fit)[0], problem.fit)
    peak = find_peak(left, machine.frame)
    problem = replace(problem, tried=problem.tried - {effect.id})
    if not peak.certain:
        return problem
    centres = [k * peak.frequency for k in range(1, OVERTONES + 1)]  # those up to the highest that a log shows
    bands = tuple((max(f - NOTCHED, SLOWEST), f + NOTCHED) for f in centres if f + ASIDE < 0.5 / machine.frame)
    torques = [*machine.effect_indices(effect.id, effect.parameters[0].name).values()]
    noise = partial(draw_phase, torques, bands, phase_rate(left, peak, machine.frame))
    detection = replace(fit_torques(problem, effect, values, peak), noise=noise)
    return replace(problem.without(bands), detected=(*problem.detected, detection))


def draw_phase(
    torques: list[int], bands: Bands, rate: float,
    problem: Problem, values: np.ndarray, trial: Trial, rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """The tremor of a robot with a phase that walks, less that with its one frequency: (n, columns) [SI].

    torques: positions of its amplitudes in the flat vector `values` (parameters,). bands: that it holds [Hz]. rate: of
    the variance of its phase [rad^2/s].
    """
    from scipy.signal import hilbert

    frame, still = problem.robot.machine.frame, values.copy()
    still[torques] = 0.0
    tremor = np.subtract(*problem.predict(np.array([values, still]), trial))
    line = tremor - outside(bands, tremor, frame)
    steps = rng.normal(0.0, np.sqrt(rate * frame), len(line))
    phase = rng.uniform(0.0, 2.0 * np.pi) + np.cumsum(steps)
    return np.real(hilbert(line, axis=0) * (np.exp(1j * phase) - 1.0)[:, None])


def phase_rate(logs: list[np.ndarray], peak: Peak, frame: float) -> float:
    """Rate of a phase's variance [rad^2/s], by the strongest column of logs (n, columns), rows `frame` [s] apart."""
    from scipy.signal import hilbert

    band = ((max(peak.frequency - ASIDE, SLOWEST), peak.frequency + ASIDE),)
    lag, turns = round(LAG / frame), []
    for signal in (log[:, [np.argmax(peak.power)]] for log in logs):
        line = np.asarray(hilbert((signal - outside(band, signal, frame))[:, 0]))
        unit = line / np.maximum(np.abs(line), 1e-12)
        turns.append(unit[lag:] * np.conj(unit[:-lag]))
    coherence = abs(np.mean(np.concatenate(turns)))
    return -2.0 * float(np.log(max(coherence, LEAST))) / LAG


def find_peak(logs: list[np.ndarray], frame: float) -> Peak:
    """The most prominent peak in residuals (n, columns) [noise_std] of logs, rows `frame` [s] apart.

    Logs shorter than a window have no fine spectrum: they are left out where others are longer.
    """
    logs = [log for log in logs if len(log) >= round(WINDOW / frame)] or logs
    frequency, densities = compute_spectra(logs, frame)
    sums = densities.sum(axis=2)
    sought = frequency[(frequency >= LOWEST) & (frequency <= min(HIGHEST, frequency[-1] - ASIDE))]
    if not len(sought):
        return Peak(LOWEST, np.zeros(densities.shape[2]), 0.0, 0.0)
    prominences = []  # in the log where it is least
    for away in (np.abs(frequency - centre) for centre in sought):
        ground = np.maximum(np.median(sums[:, (away > HALF) & (away < ASIDE)], axis=1), 1e-12)
        prominences.append(np.min(sums[:, away <= HALF].mean(axis=1) / ground))
    near = np.abs(frequency - sought[int(np.argmax(prominences))]) <= HALF
    centre = float(frequency[near][np.argmax(sums.sum(axis=0)[near])])
    powers = sum_band(frequency, densities, centre)
    each, power = powers.sum(axis=1), np.average(powers, axis=0, weights=[len(log) for log in logs])
    return Peak(centre, power, float(np.max(prominences)), float(each.min() / max(each.mean(), 1e-12)))


def compute_spectra(logs: Sequence[np.ndarray], frame: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (f,) [Hz] and power densities (logs, f, columns) [noise variance/Hz] of logs (n, columns).

    Windows are as long as the shortest log at most. frame: time between rows [s].
    """
    from scipy.signal import welch

    size = min(round(WINDOW / frame), *(len(log) for log in logs))
    found = [welch(log, 1.0 / frame, nperseg=size, axis=0) for log in logs]
    return found[0][0], np.array([density for _, density in found])


def sum_band(frequency: np.ndarray, densities: np.ndarray, centre: float) -> np.ndarray:
    """Power (logs, columns) of the band around a peak, above its neighbourhood."""
    away = np.abs(frequency - centre)
    beside = (away > HALF) & (away < ASIDE)
    ground = np.median(densities[:, beside], axis=1, keepdims=True) if beside.any() else 0.0
    return np.maximum((densities[:, away <= HALF] - ground).sum(axis=1) * (frequency[1] - frequency[0]), 0.0)


def fit_torques(problem: Problem, effect: Effect, values: np.ndarray, peak: Peak) -> Detection:
    """A tremor as the cause of a peak: torques by non-negative least squares on the powers of the columns."""
    from scipy.optimize import nnls

    parameters = effect_parameters(problem.robot, effect)
    joints = [i for i, p in enumerate(parameters) if p.amplitude]
    x = np.array([p.start if p.amplitude else p.coordinate(peak.frequency) for p in parameters])
    alone = np.tile(x, (len(joints), 1))  # a robot for each joint that trembles alone
    alone[:, joints] *= np.eye(len(joints))
    rows = np.array([values, *(apply(values, parameters, row) for row in alone)])
    logs = problem.predict(rows, problem.fit[0]) / problem.noise_std
    frequencies, densities = compute_spectra(logs[1:] - logs[0], problem.robot.machine.frame)
    unit, scale = sum_band(frequencies, densities, peak.frequency), np.sqrt(peak.power + 1e-3)
    shares, _ = nnls(unit.T / scale[:, None], peak.power / scale)  # a power is known the better the smaller it is
    x[joints] *= np.sqrt(shares)
    robot = apply(values, parameters, x)
    found = {problem.robot.machine.parameters[i].name: float(robot[i]) for p in parameters for i in p.index}

    def torque(value: float) -> Interval:  # of a waveform that is not known
        return Interval(value, value * (1.0 - NORMAL_90 * SHAPE_STD), value * (1.0 + NORMAL_90 * SHAPE_STD), "N m")

    affected = affected_channels(x[joints], np.diag((SHAPE_STD * x[joints]) ** 2), np.sqrt(unit.sum(axis=1)))
    torques = {parameters[joints[k]].channels[0]: torque(float(x[joints[k]])) for k in affected}
    half, (size, line) = 0.5 / WINDOW, (p.name for p in effect.parameters[:2])
    frequency = Interval(peak.frequency, peak.frequency - half, peak.frequency + half, "Hz")
    stated = {size: torque(float(np.mean([item.value for item in torques.values()]))), line: frequency}
    named = NamedEffect(effect.id, (), tuple(torques), stated, {size: torques}, name_kind(effect))
    where = f"a spectral peak at {peak.frequency:.1f} Hz is {peak.prominence:.0f} times its surroundings in every log"
    return Detection(named, found, f"{where}; its phase wanders, so that there only strength is compared")
