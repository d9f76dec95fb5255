"""Regime of a gap: how much of the residual's variance each condition explains.

A condition sorts the frames into bins; the share explained is the correlation ratio: variance of the bin means over the
whole variance, less what chance would explain. `frequency` is the share of the residual's power below 1 Hz.
"""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.filters import filled
from exodrake.diagnosis.problem import Problem, Trial

BINS = 10
SLOW = 1.0  # Hz: below it a residual counts as slow
STILL = 2e-4  # m/s: slower wires count as at rest; a few encoder counts a second
SMOOTH = 15  # frames over which the encoder's steps are averaged for direction and speed


def conditions(problem: Problem, trial: Trial, channel: int) -> dict[str, np.ndarray]:
    """Conditions of each frame (n,) for the wire or joint number `channel`, from what was measured."""
    table = {name: trial.measured[:, i] for i, name in enumerate(problem.columns)}
    if not any(name.startswith("stroke_") for name in table):
        return plain_conditions(problem, trial, channel)
    wires, joints = problem.robot.machine.axes
    period = problem.robot.machine.frame
    time = period * np.arange(len(trial.reference))
    stroke = filled(table[f"stroke_{wires[channel]}"])
    speed = np.gradient(np.convolve(stroke, np.full(SMOOTH, 1.0 / SMOOTH), "same"), period)
    direction = np.where(np.abs(speed) < STILL, 0.0, np.sign(speed))
    load = filled(table[f"tension_{wires[channel]}"])
    found = {
        "direction of motion": direction,
        "speed": np.abs(speed),
        "load": load,
        "time since reversal": since_reversal(direction, period),
        "time in trial": time,
        "slack": (load < SLACK).astype(float),
    }
    if f"angle_{joints[channel]}" in table:
        found["joint angle"] = filled(table[f"angle_{joints[channel]}"])
    return found


def plain_conditions(problem: Problem, trial: Trial, channel: int) -> dict[str, np.ndarray]:
    """The same for a machine without wires: motion is that of the joint's first measured signal, load its last one."""
    period = problem.robot.machine.frame
    mine = [i for i, c in enumerate(problem.columns) if channel_of(problem, c) == channel]
    place, last = (filled(trial.measured[:, i]) for i in (mine[0], mine[-1]))
    width = min(SMOOTH, max(1, len(place) // SMOOTH))
    speed = np.gradient(np.convolve(place, np.full(width, 1.0 / width), "same"), period)
    direction = np.where(np.abs(speed) < CRAWL * np.abs(speed).max(), 0.0, np.sign(speed))
    found = {
        "direction of motion": direction,
        "speed": np.abs(speed),
        "position": place,
        "time since reversal": since_reversal(direction, period),
        "time in trial": period * np.arange(len(trial.reference)),
    }
    return found | ({"load": last} if len(mine) > 1 else {})


CRAWL = 0.02  # of the fastest motion: slower joints count as at rest; assumed
SLACK = 0.15  # N: a wire below half the anti-slack floor of 0.3 N counts as slack


def since_reversal(direction: np.ndarray, period: float) -> np.ndarray:
    """Time since the direction last changed [s]."""
    changed = np.concatenate([[True], direction[1:] != direction[:-1]])
    last = np.maximum.accumulate(np.where(changed, np.arange(len(direction)), 0))
    return period * (np.arange(len(direction)) - last)


def explained(residual: np.ndarray, condition: np.ndarray) -> float:
    """Share of the variance of a residual (n,) that a condition (n,) explains, 0 .. 1."""
    total = residual.var()
    edges = np.unique(np.quantile(condition, np.linspace(0.0, 1.0, BINS + 1)))
    if total == 0.0 or len(edges) < 2:
        return 0.0
    values = np.unique(condition)
    bins = (
        np.searchsorted(values, condition)
        if len(values) <= BINS
        else np.clip(np.searchsorted(edges, condition, "right") - 1, 0, len(edges) - 2)
    )
    count = np.bincount(bins)
    means = np.bincount(bins, residual) / np.maximum(count, 1)
    between = float(np.sum(count * (means - residual.mean()) ** 2) / len(residual))
    return float(np.clip(between / total, 0.0, 1.0))


def regime(problem: Problem, residuals: dict[str, np.ndarray]) -> dict[str, float]:
    """Share of the residual explained by each condition, weighted over signals by their power.

    Args: residuals: trial name -> (n, columns) [floors].
    """
    shares: dict[str, float] = {}
    weight = 0.0
    for trial in (*problem.fit, *problem.holdout):
        residual = residuals[trial.name]
        for c, column in enumerate(problem.columns):
            power = float(residual[:, c] @ residual[:, c])
            for name, condition in conditions(problem, trial, channel_of(problem, column)).items():
                shares[name] = shares.get(name, 0.0) + power * explained(residual[:, c], condition)
            shares["frequency below 1 Hz"] = shares.get("frequency below 1 Hz", 0.0) + power * slow_share(
                residual[:, c], problem
            )
            weight += power
    return {name: value / max(weight, 1e-12) for name, value in sorted(shares.items(), key=lambda item: -item[1])}


def channel_of(problem: Problem, column: str) -> int:
    """EffectParameter of the wire or joint that a column belongs to."""
    channel = column.rsplit("_", 1)[1]
    wires, joints = problem.robot.machine.axes
    return wires.index(channel) if channel in wires else joints.index(channel)


def slow_share(residual: np.ndarray, problem: Problem) -> float:
    """Share of the power below SLOW."""
    power = np.abs(np.fft.rfft(residual - residual.mean())) ** 2
    frequency = np.fft.rfftfreq(len(residual), problem.robot.machine.frame)
    return float(power[frequency < SLOW].sum() / max(power.sum(), 1e-12))


def spectrum(residual: np.ndarray, period: float, pieces: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Frequency [Hz] and power density of a residual (n,), averaged over pieces (Welch, Hann)."""
    from scipy.signal import welch

    frequency, power = welch(residual, 1.0 / period, nperseg=max(64, len(residual) // pieces))
    return frequency, power
