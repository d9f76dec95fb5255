"""Noise standard deviation of each signal: from trials that repeat a reference, else from runs of the nominal robot.

Rounding to a resolution q adds q^2/12 to the noise of a reading; two runs of one motion round alike, so repeats do not
show it. Bands of frequencies in which no simulation repeats a signal are filtered out of noise and residuals.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.case import Case
from exodrake.data.log import fill_columns, fill_gaps, robust_std
from exodrake.engine.inputs import Reference
from exodrake.model.robot import Robot
from exodrake.simulation.protocols import reference_rows
from exodrake.simulation.simulate import run, write_log

Bands = tuple[tuple[float, float], ...]
STEEP = 2  # order of the filter, which runs forwards and backwards
FINE = 4096  # frequencies at which its response is taken


def sensor_noise_std(robot: Robot) -> dict[str, float]:
    """Noise standard deviation per kind of signal by the robot's parameters [SI]; none where the machine has none."""
    return robot.machine.noise_std(robot.__getitem__) if robot.machine.noise_std else {}


def noise_std(case: Case, robot: Robot, columns: tuple[str, ...], notched: Bands = ()) -> np.ndarray:
    """Noise of each column [its unit]: the larger of what runs differ by and what the sensor's parameters say.

    Runs are a trial and its repeats, where rare events count little, else two simulations of the first fitted
    reference. notched: bands [Hz] that are left out.
    """
    parameters, simulated, found = sensor_noise_std(robot), {}, []
    if not case.repeat_groups:
        reference = Reference(np.nan_to_num(reference_rows(robot.machine, case.fit_logs[0].log)), "noise")
        a, b = (write_log(run(robot, reference, seed=seed, quantisation=False)) for seed in (0, 1))
        simulated = {c: float(np.std(a[c] - b[c]) / np.sqrt(2.0)) for c in columns}
    for column in columns:
        logs = [[item.log[column] for item in group if item.log.has(column)] for group in case.repeat_groups]
        spreads = []
        for a, b in (pair for group in logs for pair in pairwise(group)):
            n = min(len(a), len(b))
            difference = without(notched, fill_gaps(a[:n] - b[:n])[:, None], robot.machine.frame)[:, 0]
            spreads.append(robust_std(difference) / np.sqrt(2.0))
        differ = float(np.median(spreads)) if spreads else 0.0
        found.append(max(parameters.get(column.rsplit("_", 1)[0], 0.0), differ or simulated.get(column, 0.0)))
        if found[-1] <= 0.0:
            raise InputError(f"{case.name}: noise of {column} unknown: nothing repeats and no sensor number says")
    return np.array(found)


@cache
def filters(bands: Bands, period: float) -> tuple[tuple[np.ndarray, ...], float]:
    """Second-order sections that stop each band, and the share of a white signal's power that they leave."""
    from scipy.signal import butter, sosfreqz

    sections = tuple(np.asarray(butter(STEEP, band, "bandstop", fs=1.0 / period, output="sos")) for band in bands)
    passed = [np.abs(sosfreqz(one, FINE)[1]) ** 4 for one in sections]  # of the power; the filter runs twice
    return sections, float(np.prod(passed, axis=0).mean())


def without(bands: Bands, signals: np.ndarray, period: float) -> np.ndarray:
    """Signals (..., n, columns) sampled every `period` [s] without some bands [Hz]; white ones keep their power."""
    return outside(bands, signals, period) / np.sqrt(filters(bands, period)[1]) if bands else signals


def outside(bands: Bands, signals: np.ndarray, period: float) -> np.ndarray:
    """Signals (..., n, columns) without some bands [Hz], all else as it is."""
    from scipy.signal import sosfiltfilt

    for sections in filters(bands, period)[0]:
        signals = sosfiltfilt(sections, signals, axis=-2)
    return signals


def mismatch(measured: np.ndarray, simulated: np.ndarray, bands: Bands, period: float) -> np.ndarray:
    """Measured less simulated signals (n, columns), NaN where nothing was measured; of a tremor its strength alone.

    No simulation repeats the phase of a tremor: in its bands [Hz] the simulated signal is given the measured phase.
    Both signals are (n, columns), sampled every `period` [s].
    """
    if not bands:
        return measured - simulated
    known = fill_columns(measured)
    seen, repeated = (signal - outside(bands, signal, period) for signal in (known, simulated))
    strength = np.sqrt(np.mean(repeated**2, axis=0) / np.maximum(np.mean(seen**2, axis=0), 1e-30))
    found = outside(bands, known - simulated, period) + seen * (1.0 - strength)
    return np.where(np.isfinite(measured), found, np.nan)
