"""Suspicious properties of a case that can still be diagnosed, a function each; those of one log are in `others`."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, pairwise
from textwrap import shorten

import numpy as np

from exodrake.core.display import in_words
from exodrake.core.machine import Machine
from exodrake.diagnosis.checks.compare import (
    ABOVE,
    CLEAR,
    ORDER,
    Channel,
    Comparison,
    fast_noise,
    find_runs,
    list_few,
    list_places,
    longest_run,
    rounding_step,
    white_share,
)
from exodrake.diagnosis.checks.others import (
    LONG,
    SMALL,
    UNLIKE,
    OtherLogs,
    beyond_limits,
    drifting_clocks,
    unlike_other_logs,
)
from exodrake.diagnosis.noise import robust_std

LONGEST = 300  # characters of a sentence
SAME = 0.5  # of a log's windows that are found in another one (assumed)
MATCH = 8  # frames in a row that are compared
FINE = 1e-6  # of a channel's standard deviation: changes closer than this are equal
CLEARLY = 4.0  # ratio of unexplained variances, channel by channel; as a factor of 2 in the residual (assumed)
EXPLAINED = 0.5  # of the variance of an exchanged channel, by the channel that it seems to be (assumed)
BEYOND = 3.0  # times the nominal robot's longest run, largest step or loudest window (assumed)
HELD = 3  # samples in a row that count as held: noise repeats a rounded value now and then
SATURATED = 0.05  # of the samples: less hardly matters (assumed)
WINDOW = 50  # frames in which the strength of a burst is taken (assumed)
USUAL = 0.9  # quantile over windows that counts as the usual strength: a burst is shorter than a tenth of a log
HALF = 0.5  # of the variance: more noise than motion, a signal-to-noise ratio of 1
NOISIER = "vibration, or noisier sensors"
LEAST_MOTION = 5.0  # motion over noise below which a signal says little: assumed
ORDERS = (8, 16)  # differences that leave little of a loop that hunts: 0.14 and 0.01 of a period of 4 frames
WHITE = 1.2  # ratio of what differences of these orders say of noise that is white (assumed: half of a hunting loop's)
LEVEL = 1e-3  # of the F test between repeats, over all channels (assumed)
CHANGED = 0.1  # of the motion, by which repeats differ in gain or offset; lost packets and tremor stay below (assumed)
CLOSE = 0.5  # distance at which two states count as one, in standard deviations of the motion (assumed)
SMOOTH = 0.01  # white share up to which a channel tells the state: its noise moves a state by 0.14, less than CLOSE
APART = 1.5  # motions by which a log differs from the others in like states (assumed)
MATCHES = 20  # frames in such states from which the median is taken (assumed)
EVERY = 5  # every fifth frame is compared, for speed


def suspicions(comparison: Comparison) -> tuple[str, ...]:
    """Sentences on what is suspicious about a case, none for a good one, whatever effects its robot has."""
    return tuple(shorten(sentence, LONGEST) for check in CHECKS for sentence in check(comparison))


def nothing_held_out(comparison: Comparison) -> list[str]:
    """A case holds no log out."""
    if comparison.case.holdout_logs:
        return []
    return [f"{comparison.case.name}: no log is held out, so closure cannot be judged on motion the fit never saw"]


def copied_logs(comparison: Comparison) -> list[str]:
    """A log holds samples of another one, or these plus a constant, perhaps cut or shifted.

    Logs are compared by hashes of the changes in successive windows, motionless windows left out.
    """
    spread = np.std(np.concatenate([pair.measured for pair in comparison.pairs]), axis=0)
    fine = FINE * np.where(spread > 0.0, spread, 1.0)
    keys = np.random.default_rng(0).integers(1, 2**62, (MATCH, len(fine)), dtype=np.int64) | 1
    prints, found = [], []
    for pair in comparison.pairs:
        steps = np.rint(np.diff(pair.measured, axis=0) / fine).astype(np.int64)
        windows = len(steps) - MATCH + 1
        hashes = np.sum([steps[k : k + windows] @ keys[k] for k in range(MATCH)], axis=0)
        prints.append((pair.item, np.unique(hashes[hashes != 0])))
    for (a, one), (b, other) in combinations(prints, 2):
        fewer, more = sorted((one, other), key=len)
        if len(fewer) and np.isin(fewer, more).mean() > SAME:
            roles = "so that nothing new is held out" if a.role != b.role else "so that it counts twice"
            found.append(f"{b.file} holds the samples of {a.file} (a constant apart), {roles}")
    return found


def another_unit(comparison: Comparison) -> list[str]:
    """A channel has the shape of the nominal robot's, times -1, 57.3, 100, 1000 or their inverses."""
    found: dict[float, list[Channel]] = {}
    for channel in comparison.channels:
        if channel.factor != 1.0:
            found.setdefault(channel.factor, []).append(channel)
    return [
        f"{list_places(channels)} are about {factor:.3g} times what the nominal robot logs: another unit or sign?"
        for factor, channels in found.items()
    ]


def references_beyond_limits(comparison: Comparison) -> list[str]:
    """A command is far beyond the limits that the robot file states."""
    machine = comparison.machine
    unit, found = machine.signal[machine.references[0].signal].unit, []
    for file, columns in beyond_limits(comparison).items():
        worst = max(columns, key=lambda c: columns[c][0] / columns[c][1])
        largest, limit = columns[worst]
        found.append(
            f"{list_few(columns)} of {file}: another unit than {unit}? "
            f"{worst} reaches {largest:.4g} {unit}, its limit is {limit:.4g} {unit}"
        )
    return found


def exchanged_columns(comparison: Comparison) -> list[str]:
    """Channels of one kind correlate clearly better with one another's simulation than with their own."""
    found: dict[tuple[str, ...], list[str]] = {}
    for pair in comparison.pairs:
        for kind in dict.fromkeys(comparison.kinds):
            own = np.flatnonzero(comparison.kinds == kind)
            best = own[best_assignment(pair.measured[:, own], pair.nominal[:, own])]
            names = [(comparison.columns[i], comparison.columns[j]) for i, j in zip(own, best) if i != j]
            if names:
                found.setdefault(tuple(f"{one} like {other}" for one, other in names), []).append(pair.item.file)
    return [
        f"{list_few(names)} of the nominal robot in {list_few(files)}: exchanged columns?"
        for names, files in found.items()
    ]


def best_assignment(measured: np.ndarray, nominal: np.ndarray) -> list[int]:
    """Nominal channel that matches each measured one; its own unless another assignment is clearly better.

    Args:
        measured: (n, channels) array.
        nominal: (n, channels) array.

    Returns:
        Index of a nominal channel for each measured one.
    """
    from scipy.optimize import linear_sum_assignment

    own = list(range(measured.shape[1]))
    a, b = (x - x.mean(axis=0) for x in (measured, nominal))
    scale = np.sqrt(np.outer((a**2).sum(axis=0), (b**2).sum(axis=0)))
    correlation = np.divide(a.T @ b, scale, out=np.zeros_like(scale), where=scale > 0.0)
    # share of variance that a nominal channel leaves with a positive gain
    unexplained = np.log(np.clip(1.0 - np.maximum(correlation, 0.0) ** 2, np.finfo(float).eps, 1.0))
    best = linear_sum_assignment(unexplained)[1]
    others = np.flatnonzero(best != own)
    if not len(others):
        return own
    gained = np.mean(unexplained[others, others] - unexplained[others, best[others]])
    sure = gained > np.log(CLEARLY) and unexplained[others, best[others]].max() < np.log(1.0 - EXPLAINED)
    return list(best) if sure else own


def gaps(comparison: Comparison) -> list[str]:
    """A column or a reference lacks samples for many frames in a row in which the log has others."""
    found, machine = [], comparison.machine
    for log, file in ((pair.item.log, pair.item.file) for pair in comparison.pairs):
        references = [c for c in machine.log_names(machine.references) if log.has(c)]
        columns = [*comparison.columns, *references]
        missing = np.column_stack([np.isnan(log[c]) for c in columns])
        missing &= ~missing.all(axis=1, keepdims=True)  # frames that are absent whole are noted on reading
        for column, absent in zip(columns, missing.T, strict=True):
            start, length = longest_run(absent)
            if length >= LONG:
                held = "; the simulated robots hold the last one" if column in references else ""
                found.append(
                    f"{column} of {file} has no samples for {length} frames from {log.time[start]:.6g} s on{held}"
                )
    return found


def frozen_channels(comparison: Comparison) -> list[str]:
    """A channel repeats one value for long while its noise, or what the other logs say of it, goes on.

    A robot that sticks or rests does so in other logs, too.
    """
    other = OtherLogs(comparison)
    found = [f"{c} of {place}" for i, c in enumerate(comparison.columns) for place in find_frozen_logs(other, i)]
    verb = "are" if len(found) > 1 else "is"
    said = f"{list_few(found)} {verb} frozen: one value repeats where the channel should move or be noisy"
    return [said] if found else []


def find_frozen_logs(other: OtherLogs, column: int) -> list[str]:
    """The logs in which a column is frozen, and where."""
    pairs = other.comparison.pairs
    values = [pair.measured[:, column] for pair in pairs]
    if np.ptp(np.concatenate(values)) == 0.0:
        return ["every log"] if any(np.ptp(pair.nominal[:, column]) > 0.0 for pair in pairs) else []
    runs = [(k, int(a), int(n)) for k, one in enumerate(values) for a, n in zip(*find_runs(one)) if n >= LONG]
    predicted = {k: other.predict(column, k) for k in {run[0] for run in runs}}
    motion = [float(np.std(predicted[k][start : start + n])) for k, start, n in runs]
    found = {}
    for (k, start, n), own in zip(runs, motion, strict=True):
        if (start, n) != longest_run(values[k]):
            continue
        stuck = [m for m, (log, *_) in zip(motion, runs, strict=True) if log != k]
        usual = max([SMALL, *stuck, *other.errors(column, k)])
        if own > UNLIKE * usual or noise_stops(other.comparison, column, k, start, n):
            found[k] = f"{pairs[k].item.file} from {pairs[k].item.log.time[start]:.6g} s on for {n} frames"
    return list(found.values())


def noise_stops(comparison: Comparison, column: int, log: int, start: int, length: int) -> bool:
    """Whether the samples of a channel change all the time but in a run of one value, which is no end of its range."""
    pair, name = comparison.pairs[log], comparison.columns[column]
    values, nominal = pair.measured[:, column], pair.nominal[:, column]
    rest = np.ones(len(values), dtype=bool)
    rest[start : start + length] = False
    if rest.sum() < LONG or length < BEYOND * max(longest_run(nominal)[1], longest_run(values[rest])[1]):
        return False
    outside = Channel(name, pair.item.file, pair.item.log.time[rest], values[rest], nominal[rest])
    noisy = outside.carries_noise and outside.noise / outside.nominal_noise > 1.0 / CLEAR
    return noisy and values[start] not in (values.min(), values.max())


def clipped_channels(comparison: Comparison) -> list[str]:
    """A channel stays at an end of its range again and again, far more than elsewhere and than the nominal robot's."""

    def held_shares(values: np.ndarray) -> tuple[float, float]:
        """Shares of the samples that repeat: visits to an end of the range, and elsewhere.

        One visit is none: so looks a robot at rest, and a channel that died.
        """
        starts, lengths = find_runs(values)
        held, at_ends = lengths >= HELD, np.zeros(len(lengths), dtype=bool)
        for end in (values.min(), values.max()):
            visits = held & (values[starts] == end)
            at_ends |= visits & (visits.sum() > 1)
        ends, elsewhere = (float(lengths[rows].sum()) / len(values) for rows in (at_ends, held & ~at_ends))
        return ends, elsewhere

    found = []
    for channel in comparison.channels:
        (ends, elsewhere), (nominal, _) = held_shares(channel.measured), held_shares(channel.nominal)
        if ends > max(SATURATED, BEYOND * nominal, BEYOND * elsewhere):
            found.append(channel)
    said = f"{list_places(found)} again and again stay at one value at an end of their range: is the signal clipped?"
    return [said] if found else []


def nothing_moves(comparison: Comparison) -> list[str]:
    """Over the logs to fit, neither a reference nor a compared channel moves by more than noise."""

    def moves(values: np.ndarray, rounding: float = 0.0) -> bool:
        return bool(np.ptp(values) > 0.0 and np.std(values) > LEAST_MOTION * max(fast_noise(values), rounding))

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

    def window_strength(values: np.ndarray) -> np.ndarray:
        """Fast noise of signals (n, channels) in successive windows, single jumps apart: (windows, channels)."""
        windows = len(values) // WINDOW
        cut = values[: windows * WINDOW].reshape(windows, WINDOW, -1)
        return np.median(np.abs(np.diff(cut, ORDER, axis=1)), axis=1)

    found = []
    for pair in comparison.pairs:
        if len(pair.measured) < WINDOW / (1.0 - USUAL):
            continue
        measured, nominal = window_strength(pair.measured), window_strength(pair.nominal)
        usual = np.maximum(np.quantile(measured, USUAL, axis=0), np.quantile(nominal, USUAL, axis=0))
        measured, nominal = (np.divide(x, usual, out=np.zeros_like(x), where=usual > 0.0) for x in (measured, nominal))
        noisy = [c.column for c in comparison.channels if c.file == pair.item.file and c.carries_noise]
        for i in map(comparison.columns.index, noisy):
            others = np.delete(measured, i, axis=1).max(axis=1, initial=1.0)
            strength = measured[:, i] / np.maximum(others, nominal[:, i])
            if (most := strength.max()) > BEYOND:
                place = f"{comparison.columns[i]} of {pair.item.file}"
                time = pair.item.log.time[WINDOW * int(strength.argmax())]
                found.append(f"{place} has a burst of {most:.2g} times its usual noise at {time:.6g} s")
    return found


def noise_as_large_as_motion(comparison: Comparison) -> list[str]:
    """More than half of a channel's variance is noise, by its whiteness or by its repeats, unlike the nominal robot."""
    found = [c for c in comparison.channels if white_share(c.measured) > max(HALF, CLEAR * white_share(c.nominal))]
    for column in comparison.columns:
        channels = comparison.audible(column)
        for group in comparison.case.repeat_groups:
            runs, shares = [c for c in channels if c.file in [item.file for item in group]], []
            if len(runs) < 2:
                continue
            for name in ("measured", "nominal"):
                variance = sum(np.var(getattr(c, name)) for c in channels)
                first, last = (getattr(c, name) for c in (runs[0], runs[-1]))
                rows = min(len(first), len(last))
                noise = robust_std(first[:rows] - last[:rows]) ** 2 / 2.0
                shares.append(len(channels) * noise / variance if variance > 0.0 else 0.0)
            found += runs if shares[0] > max(HALF, CLEAR * shares[1]) else []
    said = f"noise is as large as the motion in {list_places(found)}: almost any cause would explain such a channel"
    return [said] if found else []


def noise_unlike_robot_file(comparison: Comparison) -> list[str]:
    """The fast noise of all channels of a sensor is larger, or less, than the robot file says; what to set then.

    A diagnosis takes the noise of a sensor from the robot file, since what makes a loop hunt is a cause and no noise.
    With a noisier sensor no explanation leaves as little as it should, with a quieter one a fit may look too good.
    """
    if noise_as_large_as_motion(comparison):
        return []
    machine = comparison.machine
    groups: dict[tuple[str, str], dict[str, list[str]]] = {}
    for parameter, columns in noise_parameters(machine).items():
        compared = [c for c in columns if c in comparison.columns]
        if word := compare_noise(comparison, parameter, compared):
            groups.setdefault((without_channel(parameter), word), {})[parameter] = compared
    sentences = []
    for (name, word), found in groups.items():
        columns, repeats = (
            [column for compared in found.values() for column in compared],
            repeatability(comparison, name),
        )
        same = [p for p in machine.noise if without_channel(p) == name]
        unit = machine.signal[machine.column(columns[0].rsplit("_", 1)[0]).signal].unit
        channels = comparison.audible(columns[0])
        logged, stated = (
            in_words(float(np.median(levels)), unit)
            for levels in ([c.noise for c in channels], [c.nominal_noise for c in channels])
        )
        also = f"{name.split('.')[0]}.repeatability" if repeats else ""
        sentences.append(
            f"noise in the logs is {logged} in {list_few(columns)}, that of the nominal robot {stated}"
            + (f", between its runs {in_words(repeats, unit)}" if also else "")
            + f": {word}? Set {name if len(found) == len(same) else list_few(found)}"
            + (f" and {also}" if also else "")
        )
    return sentences


def compare_noise(comparison: Comparison, parameter: str, columns: list[str]) -> str:
    """What the noise of the columns of a sensor may be, unless it is as the robot file says or rounding hides it.

    A sensor's noise is in every log; what is fast in one of them alone is its motion. A diagnosis counts the larger of
    noise and repeatability.
    """
    heard, repeats = [comparison.audible(column) for column in columns], repeatability(comparison, parameter)
    if not heard or not all(heard):
        return ""
    simulated = [[c.noise / c.least_noise for c in channels] for channels in heard]
    counted = [[c.noise / max(c.least_noise, repeats) for c in channels] for channels in heard]
    if min(map(min, counted)) > ABOVE:
        return NOISIER
    if max(map(np.median, simulated)) < 1.0 / ABOVE and min(map(np.median, counted)) < 1.0 / CLEAR:
        return "smoothed logs, or quieter sensors"
    return ""


def logged_noise(comparison: Comparison) -> dict[str, float]:
    """Noise parameters of sensors that are noisier in the logs than the robot file says -> noise that they show [SI].

    It is white, so that differences of two orders say the same of it, and it is in every channel of every log.
    """
    found = {}
    for parameter, columns in noise_parameters(comparison.machine).items():
        compared = [c for c in columns if c in comparison.columns]
        if compare_noise(comparison, parameter, compared) != NOISIER:
            continue
        heard = comparison.audible(*compared)
        high, higher = (np.array([fast_noise(c.measured / c.factor, k) for c in heard]) for k in ORDERS)
        noise, least = np.minimum(high, higher), np.array([c.least_noise for c in heard])
        if (noise > ABOVE * least).all() and np.median(high / higher) < WHITE:
            found[parameter] = float(np.sqrt(comparison.robot[parameter] ** 2 + np.median(noise**2 - least**2)))
    return found


def without_channel(parameter: str) -> str:
    """A parameter `part.name.channel` without its channel."""
    return ".".join(parameter.split(".")[:2])


def repeatability(comparison: Comparison, parameter: str) -> float:
    """By how much runs differ by the robot file [SI], of the part that a noise parameter is of; 0 for none."""
    name = f"{parameter.split('.')[0]}.repeatability"
    return float(comparison.robot[name]) if name in comparison.machine.index else 0.0


def noise_parameters(machine: Machine) -> dict[str, list[str]]:
    """Noise parameters of sensors -> the columns whose readings they make noisy.

    A parameter `part.name`, or `part.name.channel`, is of the part that writes the readings.
    """
    written = {part.name: {name for output in part.outputs for name in output.writes} for part in machine.parts}
    found: dict[str, list[str]] = {}
    for parameter in machine.noise:
        part, _, *channel = parameter.split(".")
        columns = [c for c in machine.columns if c.signal in written.get(part, ()) and c.kind in machine.compared]
        names = machine.log_names(columns)
        found[parameter] = [n for n in names if not channel or n.endswith(f"_{channel[0]}")]
    return found


def changed_between_repeats(comparison: Comparison) -> list[str]:
    """Repeats of one reference differ in gain or offset, by an F test and by more than a small part of the motion."""
    pairs = {pair.item.file: pair for pair in comparison.pairs}
    twos = [(pairs[a.file], pairs[b.file]) for g in comparison.case.repeat_groups for a, b in pairwise(g)]
    found: dict[tuple[str, str], list[str]] = {}
    for a, b in twos:
        for i, column in enumerate(comparison.columns):
            change, p = gain_and_offset(a.measured[:, i], b.measured[:, i], a.nominal[:, i])
            if change > CHANGED and p < LEVEL / (len(twos) * len(comparison.columns)):
                found.setdefault((a.item.file, b.item.file), []).append(column)
    return [
        f"{list_few(columns)} changed in gain or offset from {a} to its repeat {b}: another robot, or one that changed?"
        for (a, b), columns in found.items()
    ]


def gain_and_offset(first: np.ndarray, second: np.ndarray, nominal: np.ndarray) -> tuple[float, float]:
    """Change in gain or offset from one run to its repeat, and the p value of an F test against white noise.

    Args:
        first: (n,) array, a channel in one run.
        second: (m,) array, the same in the other.
        nominal: (n,) array, the same of the nominal robot.

    Returns:
        The larger of both changes, in standard deviations of the motion, and the p value.
    """
    from scipy.special import fdtrc

    n = min(len(first), len(second))
    difference, motion, spread = second[:n] - first[:n], max(np.std(first), np.std(nominal)), np.std(nominal[:n])
    if spread == 0.0 or not difference.any():
        return 0.0, 1.0
    shape = (nominal[:n] - nominal[:n].mean()) / spread
    change = np.array([difference.mean(), (difference * shape).mean()])
    rest = np.sum((difference - change[0] - change[1] * shape) ** 2) / (n - 2)
    p = float(fdtrc(2, n - 2, n * np.mean(change**2) / rest)) if rest > 0.0 else 0.0
    return float(np.abs(change).max() / motion), p


def logs_of_other_robots(comparison: Comparison) -> list[str]:
    """A log differs from the others in states that count as one by more than a channel moves.

    Frames are paired by the nearest state. Causes that the diagnosis knows stay below: they act alike in one state, up
    to its history.
    """
    from scipy.spatial import KDTree

    pairs = comparison.pairs
    reference, measured, nominal = (
        np.concatenate([getattr(pair, name) for pair in pairs]) for name in ("reference", "measured", "nominal")
    )
    log = np.repeat(np.arange(len(pairs)), [len(pair.measured) for pair in pairs])
    smooth = [i for i in range(nominal.shape[1]) if max(map(white_share, (measured[:, i], nominal[:, i]))) < SMOOTH]
    state = np.hstack([reference, nominal[:, smooth]])
    state = state[:, np.ptp(state, axis=0) > 0.0]
    if len(pairs) < 2 or not state.shape[1]:
        return []
    state = state / state.std(axis=0)
    residual, motion = measured - nominal, np.maximum(measured.std(axis=0), nominal.std(axis=0))
    found: dict[str, list[str]] = {}
    for k, pair in enumerate(pairs):
        mine, others = np.flatnonzero(log == k)[::EVERY], np.flatnonzero(log != k)
        distance, nearest = KDTree(state[others]).query(state[mine], distance_upper_bound=CLOSE)
        close = np.isfinite(distance)
        if close.sum() < MATCHES:
            continue
        difference = np.abs(np.median(residual[mine[close]] - residual[others[nearest[close]]], axis=0))
        for i in smooth:
            if difference[i] > APART * motion[i]:
                found.setdefault(comparison.columns[i], []).append(pair.item.file)
    return [
        f"{column} of {list_few(files)} differs from the other logs by more than its motion in like states: "
        "another robot?"
        for column, files in found.items()
    ]


CHECKS: tuple[Callable[[Comparison], list[str]], ...] = (
    nothing_held_out,
    copied_logs,
    another_unit,
    references_beyond_limits,
    exchanged_columns,
    gaps,
    frozen_channels,
    clipped_channels,
    nothing_moves,
    bursts,
    noise_as_large_as_motion,
    noise_unlike_robot_file,
    changed_between_repeats,
    logs_of_other_robots,
    unlike_other_logs,
    drifting_clocks,
)
