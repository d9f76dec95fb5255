"""Channels with gaps, frozen samples or bursts, and cases in which no channel moves."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.checks.compare import LONG, Channel, Comparison, places
from exodrake.diagnosis.checks.noise import LEAST_MOTION, ORDER, carries_noise, moves, rounding_step
from exodrake.diagnosis.checks.scale import unit_factor

BEYOND = 3.0  # times the nominal robot's longest run, largest step or loudest window (assumed)
WINDOW = 50  # frames in which the strength of a burst is taken (assumed)
USUAL = 0.9  # quantile over windows that counts as the usual strength: a burst is shorter than a tenth of a log


def gaps(comparison: Comparison) -> list[str]:
    """A column or a reference lacks samples for many frames in a row in which the log has others."""
    found, machine = [], comparison.machine
    for pair in comparison.pairs:
        log = pair.item.log
        references = [c for c in machine.log_names(machine.references) if log.has(c)]
        columns = [*comparison.columns, *references]
        missing = np.column_stack([np.isnan(log[c]) for c in columns])
        missing &= ~missing.all(axis=1, keepdims=True)  # frames that are absent whole are noted on reading
        for column, absent in zip(columns, missing.T, strict=True):
            start, length = longest_run(absent, of=True)
            if length >= LONG:
                held = "; the simulated robots hold the last one" if column in references else ""
                where = f"for {length} frames from {log.time[start]:.6g} s on"
                found.append(f"{column} of {pair.item.file} has no samples {where}{held}")
    return found


def frozen_channels(comparison: Comparison) -> list[str]:
    """A channel repeats one value for long while the nominal robot's changes, other than by rest or saturation."""
    found = [c for c in comparison.channels if is_frozen(c)]
    return [f"{places(found)} are frozen: one value repeats where the nominal robot's changes"] if found else []


def is_frozen(channel: Channel) -> bool:
    """Whether the longest run of one value is far longer than the nominal robot's, and neither rest nor saturation.

    Noise would change the samples of a robot at rest, and a channel that was frozen jumps where it goes on.
    """
    values = channel.measured
    start, length = longest_run(values)
    if length < max(LONG, BEYOND * longest_run(channel.nominal)[1]) or length == len(values):
        return length == len(values) and np.ptp(channel.nominal) > 0.0
    changes, steps = np.abs(np.diff(values)), np.abs(np.diff(channel.nominal))
    jump = changes[max(start - 1, 0) : start + length].max() / abs(unit_factor(channel))
    saturated = values[start] in (values.min(), values.max())
    return bool(jump > BEYOND * steps.max() or (carries_noise(channel) and not saturated))


def longest_run(values: np.ndarray, of: object = None) -> tuple[int, int]:
    """Start and length of the longest run of equal values (n,), or of the value `of`."""
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
    lengths = np.diff(starts, append=len(values))
    if of is not None:
        lengths = np.where(values[starts] == of, lengths, 0)
    k = int(lengths.argmax())
    return int(starts[k]), int(lengths[k])


def nothing_moves(comparison: Comparison) -> list[str]:
    """Over the logs to fit, neither a reference nor a compared channel moves by more than noise."""
    pairs = [pair for pair in comparison.pairs if pair.item.role == "fit"]
    references, channels = (np.concatenate([getattr(p, x) for p in pairs]).T for x in ("reference", "measured"))
    if any(map(moves, references)) or any(moves(values, rounding_step(values)) for values in channels):
        return []
    return [
        "nothing moves in the logs to fit: the references are constant and no channel varies by more than "
        f"{LEAST_MOTION:g} times its noise, so hardly any effect can show; record a motion"
    ]


def bursts(comparison: Comparison) -> list[str]:
    """Fast noise is many times as strong as usual for a while in one channel alone, so not by a motion of the robot."""
    found = []
    for pair in comparison.pairs:
        if len(pair.measured) < WINDOW / (1.0 - USUAL):
            continue
        measured, nominal = window_strength(pair.measured), window_strength(pair.nominal)
        usual = np.maximum(np.quantile(measured, USUAL, axis=0), np.quantile(nominal, USUAL, axis=0))
        measured, nominal = (np.divide(x, usual, out=np.zeros_like(x), where=usual > 0.0) for x in (measured, nominal))
        noisy = [c.column for c in comparison.channels if c.file == pair.item.file and carries_noise(c)]
        for i in map(comparison.columns.index, noisy):
            others = np.delete(measured, i, axis=1).max(axis=1, initial=1.0)
            strength = measured[:, i] / np.maximum(others, nominal[:, i])
            if (most := strength.max()) > BEYOND:
                place = f"{comparison.columns[i]} of {pair.item.file}"
                time = pair.item.log.time[WINDOW * int(strength.argmax())]
                found.append(f"{place} has a burst of {most:.2g} times its usual noise at {time:.6g} s")
    return found


def window_strength(values: np.ndarray) -> np.ndarray:
    """Fast noise of signals (n, channels) in successive windows, single jumps apart: (windows, channels)."""
    windows = len(values) // WINDOW
    cut = values[: windows * WINDOW].reshape(windows, WINDOW, -1)
    return np.median(np.abs(np.diff(cut, ORDER, axis=1)), axis=1)
