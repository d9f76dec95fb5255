"""Channels with gaps, frozen samples or bursts, and cases in which no channel moves."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.checks.compare import LONG, Channel, Comparison, few, places
from exodrake.diagnosis.checks.noise import CLEAR, LEAST_MOTION, ORDER, carries_noise, louder, moves, rounding_step
from exodrake.diagnosis.checks.others import SMALL, UNLIKE, OtherLogs

BEYOND = 3.0  # times the nominal robot's longest run, largest step or loudest window (assumed)
HELD = 3  # samples in a row that count as held: noise repeats a rounded value now and then
SATURATED = 0.05  # of the samples: less hardly matters (assumed)
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
    """A channel repeats one value for long while its noise, or what the other logs say of it, goes on.

    A robot that sticks or rests does so in other logs, too.
    """
    other = OtherLogs(comparison)
    found = [f"{c} of {place}" for i, c in enumerate(comparison.columns) for place in frozen_logs(other, i)]
    verb = "are" if len(found) > 1 else "is"
    said = f"{few(found)} {verb} frozen: one value repeats where the channel should move or be noisy"
    return [said] if found else []


def frozen_logs(other: OtherLogs, column: int) -> list[str]:
    """The logs in which a column is frozen, and where."""
    pairs = other.comparison.pairs
    values = [pair.measured[:, column] for pair in pairs]
    if np.ptp(np.concatenate(values)) == 0.0:
        return ["every log"] if any(np.ptp(pair.nominal[:, column]) > 0.0 for pair in pairs) else []
    runs = [(k, *run) for k, one in enumerate(values) for run in long_runs(one)]
    if not runs:
        return []
    predicted = {k: other.predicted(column, k) for k in {run[0] for run in runs}}
    moved = [float(np.std(predicted[k][start : start + n])) for k, start, n in runs]
    found = {}
    for (k, start, n), own in zip(runs, moved, strict=True):
        if (start, n) != longest_run(values[k]):
            continue
        stuck = [m for m, (log, *_) in zip(moved, runs, strict=True) if log != k]
        usual = max([SMALL, *stuck, *other.errors(column, k)])
        if own > UNLIKE * usual or noise_stops(other.comparison, column, k, start, n):
            found[k] = f"{pairs[k].item.file} from {pairs[k].item.log.time[start]:.6g} s on for {n} frames"
    return list(found.values())


def long_runs(values: np.ndarray) -> list[tuple[int, int]]:
    """Starts and lengths of all runs of `LONG` or more equal values (n,)."""
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
    lengths = np.diff(starts, append=len(values))
    return [(int(a), int(n)) for a, n in zip(starts, lengths, strict=True) if n >= LONG]


def noise_stops(comparison: Comparison, column: int, log: int, start: int, length: int) -> bool:
    """Whether the samples of a channel change all the time but in a run of one value, which is no end of its range."""
    pair, name = comparison.pairs[log], comparison.columns[column]
    values, nominal = pair.measured[:, column], pair.nominal[:, column]
    rest = np.ones(len(values), dtype=bool)
    rest[start : start + length] = False
    if rest.sum() < LONG or length < BEYOND * max(longest_run(nominal)[1], longest_run(values[rest])[1]):
        return False
    outside = Channel(name, pair.item.file, pair.item.log.time[rest], values[rest], nominal[rest])
    noisy = carries_noise(outside) and louder(outside) > 1.0 / CLEAR
    return noisy and values[start] not in (values.min(), values.max())


def clipped_channels(comparison: Comparison) -> list[str]:
    """A channel that else hardly repeats a value stays at an end of its range again and again."""
    found = [c for c in comparison.channels if is_clipped(c)]
    if not found:
        return []
    return [f"{places(found)} again and again stay at one value at an end of their range: is the signal clipped?"]


def is_clipped(channel: Channel) -> bool:
    """Whether a channel is held at an end of its range far more than elsewhere, and than the nominal robot's."""
    (ends, elsewhere), (nominal, _) = held_shares(channel.measured), held_shares(channel.nominal)
    return ends > max(SATURATED, BEYOND * nominal, BEYOND * elsewhere)


def held_shares(values: np.ndarray) -> tuple[float, float]:
    """Shares of a signal's (n,) samples that repeat for `HELD` or more: visits to an end of the range, and elsewhere.

    One visit is none: so looks a robot at rest, and a channel that died.
    """
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    lengths = np.diff(starts, append=len(values))
    held = lengths >= HELD
    visits = [held & (values[starts] == end) for end in (values.min(), values.max())]
    ends = [one if one.sum() > 1 else np.zeros_like(one) for one in visits]
    at_ends = ends[0] | ends[1]
    shares = [float(lengths[rows].sum()) / len(values) for rows in (at_ends, held & ~at_ends)]
    return shares[0], shares[1]


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
