"""Suspicious properties of a case that can still be diagnosed: a table of checks, each a function with its sentence.

Most checks compare a statistic of a measured channel with the same statistic of the nominal robot's. The last ones
compare a log with the other logs: its channel is predicted by a linear model that is fitted on the others, from the
references, what the nominal robot does on them, and the log's channels of other kinds. An effect of the robot acts on
all logs and so is in the model, as far as it is linear; what is wrong with one log is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, pairwise
from textwrap import shorten

import numpy as np

from exodrake.core.display import in_words
from exodrake.core.errors import InputError
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
LONG = 25  # frames: what lasts shorter is neither a gap nor frozen (assumed: longer than packets are lost in a row)
ANOTHER_UNIT = 10.0**0.5  # times a limit; geometrically half-way to the smallest factor of another decimal unit
# Times the largest error of the other logs: with few logs an error three times the largest is rare in any law without
# heavy tails, and healthy robots, simulated and real, stay below 2.7
UNLIKE = 3.0
SMALL = 0.03  # of the motion: the scatter of nominal parameters; predictions are not trusted further
RIDGE = 1e-3  # of the variance: columns that move alike share their weight
BLOCKS = 10  # of a log, in each of which a delay is taken: the scatter about a line then says how sure its slope is
DRIFTING = 7.0  # standard errors of a slope; predictions err alike for long, so that healthy robots reach 6
STILL = 1e-6  # of a column's motion over all logs: less in most of them is rounding, and the column rests there
ALONE = 0.75  # of an error, from which its cause is named


def suspicions(comparison: Comparison) -> tuple[str, ...]:
    """Sentences on what is suspicious about a case, none for a good one, whatever effects its robot has."""
    return tuple(shorten(sentence, LONGEST) for check in CHECKS for sentence in check(comparison))


def nothing_held_out(comparison: Comparison) -> Iterator[str]:
    """A case holds no log out."""
    if not comparison.case.holdout_logs:
        yield f"{comparison.case.name}: no log is held out, so closure cannot be judged on motion the fit never saw"


def copied_logs(comparison: Comparison) -> Iterator[str]:
    """A log holds samples of another one, or these plus a constant, perhaps cut or shifted.

    Logs are compared by hashes of the changes in successive windows, motionless windows left out.
    """
    spread = np.std(np.concatenate([pair.measured for pair in comparison.pairs]), axis=0)
    fine = FINE * np.where(spread > 0.0, spread, 1.0)
    keys = np.random.default_rng(0).integers(1, 2**62, (MATCH, len(fine)), dtype=np.int64) | 1
    prints = []
    for pair in comparison.pairs:
        steps = np.rint(np.diff(pair.measured, axis=0) / fine).astype(np.int64)
        windows = len(steps) - MATCH + 1
        hashes = np.sum([steps[k : k + windows] @ keys[k] for k in range(MATCH)], axis=0)
        prints.append((pair.item, np.unique(hashes[hashes != 0])))
    for (a, one), (b, other) in combinations(prints, 2):
        fewer, more = sorted((one, other), key=len)
        if len(fewer) and np.isin(fewer, more).mean() > SAME:
            roles = "so that nothing new is held out" if a.role != b.role else "so that it counts twice"
            yield f"{b.file} holds the samples of {a.file} (a constant apart), {roles}"


def another_unit(comparison: Comparison) -> Iterator[str]:
    """A channel has the shape of the nominal robot's, times -1, 57.3, 100, 1000 or their inverses."""
    found: dict[float, list[Channel]] = {}
    for channel in (c for c in comparison.channels if c.factor != 1.0):
        found.setdefault(channel.factor, []).append(channel)
    for factor, channels in found.items():
        yield f"{list_places(channels)} are about {factor:.3g} times what the nominal robot logs: another unit or sign?"


def find_far_references(comparison: Comparison) -> dict[str, str]:
    """File -> sentence on commands far beyond the limits of the robot file; a measured motion has no limit."""
    machine, found = comparison.machine, {}
    if not (machine.references[0].kind.endswith("_ref") and machine.reference_limits and comparison.robot.limits):
        return {}
    try:
        limits = np.maximum(*map(np.abs, comparison.robot.reference_limits()))
    except InputError:  # not stated for each channel
        return {}
    columns, unit = machine.log_names(machine.references[:1]), machine.signal[machine.references[0].signal].unit
    for pair in comparison.pairs:
        largest = np.abs(pair.reference[:, : len(columns)]).max(axis=0)
        ratios = np.divide(largest, limits, out=np.zeros_like(largest), where=limits > 0.0)
        if (worst := int(ratios.argmax())) in (beyond := np.flatnonzero(ratios > ANOTHER_UNIT)):
            found[pair.item.file] = (
                f"{list_few(columns[k] for k in beyond)} of {pair.item.file}: another unit than {unit}? "
                f"{columns[worst]} reaches {largest[worst]:.4g} {unit}, its limit is {limits[worst]:.4g} {unit}"
            )
    return found


def references_beyond_limits(comparison: Comparison) -> Iterator[str]:
    """A command is far beyond the limits that the robot file states."""
    yield from find_far_references(comparison).values()


def exchanged_columns(comparison: Comparison) -> Iterator[str]:
    """Channels of one kind correlate clearly better with one another's simulation than with their own."""
    found: dict[str, list[str]] = {}
    for pair in comparison.pairs:
        for kind in dict.fromkeys(comparison.kinds):
            own = np.flatnonzero(comparison.kinds == kind)
            best = own[best_assignment(pair.measured[:, own], pair.nominal[:, own])]
            names = [f"{comparison.columns[i]} like {comparison.columns[j]}" for i, j in zip(own, best) if i != j]
            if names:
                found.setdefault(list_few(names), []).append(pair.item.file)
    for names, files in found.items():
        yield f"{names} of the nominal robot in {list_few(files)}: exchanged columns?"


def best_assignment(measured: np.ndarray, nominal: np.ndarray) -> list[int]:
    """Nominal channel (n, channels) that matches each measured one; its own unless others are clearly better."""
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
    left = unexplained[others, best[others]]
    gained = np.mean(unexplained[others, others] - left)
    return list(best) if gained > np.log(CLEARLY) and left.max() < np.log(1.0 - EXPLAINED) else own


def gaps(comparison: Comparison) -> Iterator[str]:
    """A column or a reference lacks samples for many frames in a row in which the log has others."""
    for log, file in ((pair.item.log, pair.item.file) for pair in comparison.pairs):
        references = [c for c in comparison.machine.log_names(comparison.machine.references) if log.has(c)]
        columns = [*comparison.columns, *references]
        missing = np.column_stack([np.isnan(log[c]) for c in columns])
        missing &= ~missing.all(axis=1, keepdims=True)  # frames that are absent whole are noted on reading
        for column, (start, length) in zip(columns, map(longest_run, missing.T), strict=True):
            if length >= LONG:
                held = "; the simulated robots hold the last one" if column in references else ""
                yield f"{column} of {file} has no samples for {length} frames from {log.time[start]:.6g} s on{held}"


def frozen_channels(comparison: Comparison) -> Iterator[str]:
    """A channel repeats one value for long while its noise, or what the other logs say of it, goes on.

    A robot that sticks or rests does so in other logs, too.
    """
    other, pairs, found = OtherLogs(comparison), comparison.pairs, []
    for column, name in enumerate(comparison.columns):
        values = [pair.measured[:, column] for pair in pairs]
        if np.ptp(np.concatenate(values)) == 0.0:
            moves = any(np.ptp(pair.nominal[:, column]) > 0.0 for pair in pairs)
            found += [f"{name} of every log"] if moves else []
            continue
        runs = [(k, int(a), int(n)) for k, one in enumerate(values) for a, n in zip(*find_runs(one)) if n >= LONG]
        predicted = {k: other.predict(column, k) for k in {run[0] for run in runs}}
        motion = [float(np.std(predicted[k][start : start + n])) for k, start, n in runs]
        frozen = {}
        for (k, start, n), own in zip(runs, motion, strict=True):
            if (start, n) == longest_run(values[k]):
                stuck = [m for m, (log, *_) in zip(motion, runs, strict=True) if log != k]
                usual = max([SMALL, *stuck, *other.errors(column, k)])
                if own > UNLIKE * usual or noise_stops(comparison, column, k, start, n):
                    item = pairs[k].item
                    frozen[k] = f"{name} of {item.file} from {item.log.time[start]:.6g} s on for {n} frames"
        found += frozen.values()
    if found:
        verb = "are" if len(found) > 1 else "is"
        yield f"{list_few(found)} {verb} frozen: one value repeats where the channel should move or be noisy"


def noise_stops(comparison: Comparison, column: int, log: int, start: int, length: int) -> bool:
    """Whether the samples of a channel change all the time but in a run of one value, which is no end of its range."""
    pair = comparison.pairs[log]
    values, nominal = pair.measured[:, column], pair.nominal[:, column]
    rest = np.ones(len(values), dtype=bool)
    rest[start : start + length] = False
    if rest.sum() < LONG or length < BEYOND * max(longest_run(nominal)[1], longest_run(values[rest])[1]):
        return False
    outside = Channel(comparison.columns[column], pair.item.file, values[rest], nominal[rest])
    noisy = outside.carries_noise and outside.noise / outside.nominal_noise > 1.0 / CLEAR
    return noisy and values[start] not in (values.min(), values.max())


def clipped_channels(comparison: Comparison) -> Iterator[str]:
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
        return float(lengths[at_ends].sum()) / len(values), float(lengths[held & ~at_ends].sum()) / len(values)

    found = []
    for channel in comparison.channels:
        (ends, elsewhere), (nominal, _) = held_shares(channel.measured), held_shares(channel.nominal)
        found += [channel] if ends > max(SATURATED, BEYOND * nominal, BEYOND * elsewhere) else []
    if found:
        yield f"{list_places(found)} again and again stay at one value at an end of their range: is the signal clipped?"


def nothing_moves(comparison: Comparison) -> Iterator[str]:
    """Over the logs to fit, neither a reference nor a compared channel moves by more than noise."""

    def moves(values: np.ndarray, rounding: float = 0.0) -> bool:
        return bool(np.ptp(values) > 0.0 and np.std(values) > LEAST_MOTION * max(fast_noise(values), rounding))

    pairs = [pair for pair in comparison.pairs if pair.item.role == "fit"]
    references, channels = (np.concatenate([getattr(p, x) for p in pairs]).T for x in ("reference", "measured"))
    if not any(map(moves, references)) and not any(moves(values, rounding_step(values)) for values in channels):
        yield (
            "nothing moves in the logs to fit: the references are constant and no channel varies by more than "
            f"{LEAST_MOTION:g} times its noise, so hardly any effect can show; record a motion"
        )


def bursts(comparison: Comparison) -> Iterator[str]:
    """Fast noise is many times as strong as usual for a while in one channel alone, so not by a motion of the robot."""

    def window_strength(values: np.ndarray) -> np.ndarray:
        """Fast noise of signals (n, channels) in successive windows, single jumps apart: (windows, channels)."""
        cut = values[: len(values) // WINDOW * WINDOW].reshape(-1, WINDOW, values.shape[1])
        return np.median(np.abs(np.diff(cut, ORDER, axis=1)), axis=1)

    for pair in (p for p in comparison.pairs if len(p.measured) >= WINDOW / (1.0 - USUAL)):
        strengths = [window_strength(pair.measured), window_strength(pair.nominal)]
        usual = np.max([np.quantile(x, USUAL, axis=0) for x in strengths], axis=0)
        measured, nominal = (np.divide(x, usual, out=np.zeros_like(x), where=usual > 0.0) for x in strengths)
        noisy = [c.column for c in comparison.channels if c.file == pair.item.file and c.carries_noise]
        for i in map(comparison.columns.index, noisy):
            others = np.delete(measured, i, axis=1).max(axis=1, initial=1.0)
            strength = measured[:, i] / np.maximum(others, nominal[:, i])
            if (most := strength.max()) > BEYOND:
                time = pair.item.log.time[WINDOW * int(strength.argmax())]
                place = f"{comparison.columns[i]} of {pair.item.file}"
                yield f"{place} has a burst of {most:.2g} times its usual noise at {time:.6g} s"


def noise_as_large_as_motion(comparison: Comparison) -> Iterator[str]:
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
    if found:
        yield f"noise is as large as the motion in {list_places(found)}: almost any cause would explain such a channel"


def noise_unlike_robot_file(comparison: Comparison) -> Iterator[str]:
    """The fast noise of all channels of a sensor is larger, or less, than the robot file says; what to set then.

    A diagnosis takes the noise of a sensor from the robot file, since what makes a loop hunt is a cause and no noise.
    With a noisier sensor no explanation leaves as little as it should, with a quieter one a fit may look too good.
    """
    machine, groups = comparison.machine, dict[tuple[str, str, float], dict[str, list[str]]]()
    for parameter, columns, repeats, word in compare_noise(comparison):
        groups.setdefault((without_channel(parameter), word, repeats), {})[parameter] = columns
    for (name, word, repeats), found in groups.items() if not any(noise_as_large_as_motion(comparison)) else ():
        columns = [column for each in found.values() for column in each]
        unit = machine.signal[machine.column(columns[0].rsplit("_", 1)[0]).signal].unit
        levels = np.median([(c.noise, c.nominal_noise) for c in comparison.audible(columns[0])], axis=0)
        logged, stated, repeated = (in_words(float(level), unit) for level in (*levels, repeats))
        whole = len(found) == sum(without_channel(p) == name for p in machine.noise)
        set_to, also = name if whole else list_few(found), f"{name.split('.')[0]}.repeatability"
        yield (
            f"noise in the logs is {logged} in {list_few(columns)}, that of the nominal robot {stated}"
            + (
                f", between its runs {repeated}: {word}? Set {set_to} and {also}"
                if repeats
                else f": {word}? Set {set_to}"
            )
        )


def compare_noise(comparison: Comparison) -> Iterator[tuple[str, list[str], float, str]]:
    """Noise parameters that the logs contradict, their compared columns, repeatability, and what the noise may be.

    A sensor's noise is in every log; what is fast in one of them alone is its motion. A diagnosis counts the larger of
    noise and repeatability. What rounding hides is not judged.
    """
    for parameter, names in noise_parameters(comparison.machine).items():
        columns, repeats = [c for c in names if c in comparison.columns], f"{parameter.split('.')[0]}.repeatability"
        repeats = float(comparison.robot[repeats]) if repeats in comparison.machine.index else 0.0
        heard = [comparison.audible(column) for column in columns]
        if not heard or not all(heard):
            continue
        simulated = [[c.noise / c.least_noise for c in channels] for channels in heard]
        counted = [[c.noise / max(c.least_noise, repeats) for c in channels] for channels in heard]
        if min(map(min, counted)) > ABOVE:
            yield parameter, columns, repeats, NOISIER
        elif max(map(np.median, simulated)) < 1.0 / ABOVE and min(map(np.median, counted)) < 1.0 / CLEAR:
            yield parameter, columns, repeats, "smoothed logs, or quieter sensors"


def logged_noise(comparison: Comparison) -> dict[str, float]:
    """Noise parameters of sensors that are noisier in the logs than the robot file says -> noise that they show [SI].

    It is white, so that differences of two orders say the same of it, and it is in every channel of every log.
    """
    found = {}
    for parameter, columns, _, word in compare_noise(comparison):
        heard = comparison.audible(*columns)
        high, higher = (np.array([fast_noise(c.measured / c.factor, k) for c in heard]) for k in ORDERS)
        noise, least = np.minimum(high, higher), np.array([c.least_noise for c in heard])
        if word == NOISIER and (noise > ABOVE * least).all() and np.median(high / higher) < WHITE:
            found[parameter] = float(np.sqrt(comparison.robot[parameter] ** 2 + np.median(noise**2 - least**2)))
    return found


def without_channel(parameter: str) -> str:
    """A parameter `part.name.channel` without its channel."""
    return ".".join(parameter.split(".")[:2])


def noise_parameters(machine: Machine) -> dict[str, list[str]]:
    """Noise parameters `part.name` or `part.name.channel` -> the columns with readings that the part writes."""
    written = {part.name: {name for output in part.outputs for name in output.writes} for part in machine.parts}
    found: dict[str, list[str]] = {}
    for parameter in machine.noise:
        part, _, *channel = parameter.split(".")
        columns = [c for c in machine.columns if c.signal in written.get(part, ()) and c.kind in machine.compared]
        names = machine.log_names(columns)
        found[parameter] = [n for n in names if not channel or n.endswith(f"_{channel[0]}")]
    return found


def changed_between_repeats(comparison: Comparison) -> Iterator[str]:
    """Repeats of one reference differ in gain or offset, by an F test and by more than a small part of the motion."""
    pairs = {pair.item.file: pair for pair in comparison.pairs}
    twos = [(pairs[a.file], pairs[b.file]) for g in comparison.case.repeat_groups for a, b in pairwise(g)]
    found: dict[tuple[str, str], list[str]] = {}
    for a, b in twos:
        for i, column in enumerate(comparison.columns):
            change, p = gain_and_offset(a.measured[:, i], b.measured[:, i], a.nominal[:, i])
            if change > CHANGED and p < LEVEL / (len(twos) * len(comparison.columns)):
                found.setdefault((a.item.file, b.item.file), []).append(column)
    for (a, b), columns in found.items():
        names = list_few(columns)
        yield f"{names} changed in gain or offset from {a} to its repeat {b}: another robot, or one that changed?"


def gain_and_offset(first: np.ndarray, second: np.ndarray, nominal: np.ndarray) -> tuple[float, float]:
    """Larger change in gain or offset between two runs of a channel [motions], and p by an F test against white noise.

    Args:
        first: (n,) one run.
        second: (m,) the other.
        nominal: (n,) the nominal robot's first run.
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


def logs_of_other_robots(comparison: Comparison) -> Iterator[str]:
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
        return
    state = state / state.std(axis=0)
    residual, motion = measured - nominal, np.maximum(measured.std(axis=0), nominal.std(axis=0))
    found: dict[str, list[str]] = {}
    for k, pair in enumerate(pairs):
        mine, others = np.flatnonzero(log == k)[::EVERY], np.flatnonzero(log != k)
        distance, nearest = KDTree(state[others]).query(state[mine], distance_upper_bound=CLOSE)
        close = np.isfinite(distance)
        if close.sum() >= MATCHES:
            apart = np.abs(np.median(residual[mine[close]] - residual[others[nearest[close]]], axis=0))
            for i in (i for i in smooth if apart[i] > APART * motion[i]):
                found.setdefault(comparison.columns[i], []).append(pair.item.file)
    for column, files in found.items():
        place = f"{column} of {list_few(files)}"
        yield f"{place} differs from the other logs by more than its motion in like states: another robot?"


class OtherLogs:
    """Predictions of the channels of each log by linear models of the other logs.

    Columns are references, nominal and measured ones about their median means, in units of their typical motion, that
    of a measured one no less than the nominal's. Logs on one reference predict each other too well and do not count.
    """

    def __init__(self, comparison: Comparison) -> None:
        self.comparison, width = comparison, len(comparison.columns)
        raw = [np.hstack([p.reference, p.nominal, p.measured]) for p in comparison.pairs]
        spread, largest = np.median([rows.std(axis=0) for rows in raw], axis=0), np.vstack(raw).std(axis=0)
        spread[-width:] = np.maximum(spread[-width:], spread[-2 * width : -width])
        self.scale = np.where(spread > STILL * largest, spread, np.where(largest > 0.0, largest, 1.0))
        self.middle = np.median([rows.mean(axis=0) for rows in raw], axis=0)
        self.rows = [np.column_stack([np.ones(len(rows)), (rows - self.middle) / self.scale]) for rows in raw]
        self.moments = np.array([rows.T @ rows / len(rows) for rows in self.rows])
        self.first = self.moments.shape[1] - width  # measured column in `rows`
        self.repeats = np.eye(len(raw), dtype=bool)
        for i, k in combinations(range(len(raw)), 2):
            a, b = (comparison.pairs[log].reference for log in (i, k))
            rows, tolerance = min(len(a), len(b)), 1e-9 * float(np.abs(a).max(initial=1e-9))
            self.repeats[i, k] = self.repeats[k, i] = np.allclose(a[:rows], b[:rows], rtol=0.0, atol=tolerance)

    def fit_weights(self, column: int, logs: Sequence[int], without: Sequence[str] = ()) -> np.ndarray:
        """Weights (1 + c,) that predict a column, fitted on some logs; kinds that take no part, its own among them."""
        kinds = self.comparison.kinds
        others = self.first + np.flatnonzero(~np.isin(kinds, [kinds[column], *without]))
        used = np.concatenate([np.arange(self.first), others])
        moments, ridge = self.moments[list(logs)].mean(axis=0), np.full(len(used), RIDGE)
        ridge[0] = 0.0
        found = np.zeros(len(moments))
        target = moments[used, self.first + column]
        found[used] = np.linalg.solve(moments[np.ix_(used, used)] + np.diag(ridge), target)
        return found

    def error(self, column: int, log: int, logs: Sequence[int], without: Sequence[str] = ()) -> float:
        """RMS error of a column of a log by a fit on some logs [motions]."""
        off = -self.fit_weights(column, logs, without)
        off[self.first + column] += 1.0
        return float(np.sqrt(max(off @ self.moments[log] @ off, 0.0)))

    def errors(self, column: int, log: int, without: Sequence[str] = ()) -> list[float]:
        """Errors of a column in each other log, by fits that know neither of both; none with fewer than three logs."""
        logs = np.arange(len(self.rows))
        known = {k: logs[(logs != log) & ~self.repeats[k]] for k in map(int, logs[logs != log])}
        return [self.error(column, k, list(some), without) for k, some in known.items() if len(some)]

    def predict(self, column: int, log: int, without: Sequence[str] = ()) -> np.ndarray:
        """A column of a log (n,) by a fit on the others; the nominal robot's where there is no other."""
        others = [k for k in range(len(self.rows)) if k != log]
        if others:
            return self.rows[log] @ self.fit_weights(column, others, without)
        place = self.first + column - 1
        return (self.comparison.pairs[log].nominal[:, column] - self.middle[place]) / self.scale[place]

    def explain_error(self, column: int, log: int, without: Sequence[str] = ()) -> tuple[float, str]:
        """How many times the usual error is the part of a column's error that a gain, offset or delay explains.

        What none of them explains is left to the robot: an effect may show in one motion alone.

        Returns:
            The ratio, 0 for an error that is usual, and the one of the three that suffices, in words.
        """
        usual = max([SMALL, *(errors := self.errors(column, log, without))])
        if not errors:
            return 0.0, ""
        rms = self.error(column, log, [k for k in range(len(self.rows)) if k != log], without)
        if rms <= UNLIKE * usual:
            return 0.0, ""
        scale, level = (x[self.first + column - 1] for x in (self.scale, self.middle / self.scale))
        unit = self.comparison.pairs[log].item.log.units[self.comparison.columns[column]]
        h, y = self.predict(column, log, without), self.rows[log][:, self.first + column]
        error, n, true = y - h, len(y), h + level
        a, b = (np.fft.rfft(x - x.mean(), 2 * n) for x in (y, h))
        lags = np.arange(-(n // 4), n // 4 + 1)
        late = int(lags[np.argmax(np.fft.irfft(a * b.conj(), 2 * n)[lags])])
        shifted = h[np.clip(np.arange(n) - late, 0, n - 1)]
        gain = float(true @ (y + level) / (true @ true))
        both = np.column_stack([h, np.ones(n)])
        linear = error - both @ np.linalg.lstsq(both, error, rcond=None)[0]
        left = {
            f"about {gain:.3g} times what they say": error - (gain - 1.0) * true,
            f"{error.mean() * scale:+.3g} {unit} apart": error - error.mean(),
            f"{late * self.comparison.machine.frame:+.3g} s late": y - shifted,
        }
        shares = {words: 1.0 - float(rest @ rest / (error @ error)) for words, rest in left.items()}
        best = max(shares, key=lambda words: shares[words])
        share = max(shares[best], 1.0 - float(linear @ linear / (error @ error)))
        return rms * float(np.sqrt(share)) / usual, best if shares[best] > ALONE else ""

    def delay_slope(self, kind: str, log: int) -> tuple[float, float]:
        """By how much the delay of a kind of channel grows in a log [frames/frame], and that over its standard error.

        In each block of the log the error is fitted by offset, gain and delay; a line goes through the delays.
        """
        found = []
        for column in map(int, np.flatnonzero(self.comparison.kinds == kind)):
            predicted = self.predict(column, log)
            error = self.rows[log][:, self.first + column] - predicted
            speed = np.gradient(np.convolve(np.pad(predicted, 2, mode="edge"), np.ones(5) / 5.0, "valid"))
            for block in np.array_split(np.arange(len(predicted)), BLOCKS):
                if len(block) < LONG or not np.ptp(speed[block]) > 0.0:
                    continue
                level = predicted[block] - predicted[block].mean()
                shape = np.column_stack([np.ones(len(block)), level, speed[block]])
                inverse = np.linalg.pinv(shape.T @ shape)
                fitted = inverse @ (shape.T @ error[block])
                left = np.mean((error[block] - shape @ fitted) ** 2)
                if inverse[2, 2] > 0.0 and left > 0.0:
                    found.append((block.mean(), -fitted[2], 1.0 / (inverse[2, 2] * left)))
        if len(found) < BLOCKS // 2:
            return 0.0, 0.0
        time, delay, weight = np.array(found).T
        time, delay = (x - np.average(x, weights=weight) for x in (time, delay))
        spread = weight @ time**2
        if not spread > 0.0:
            return 0.0, 0.0
        slope = float(weight @ (time * delay) / spread)
        error = float(np.sqrt(weight @ (delay - slope * time) ** 2 / (len(time) - 2) / spread))
        return slope, abs(slope) / error if error > 0.0 else 0.0


def unlike_other_logs(comparison: Comparison) -> Iterator[str]:
    """Channels of one log err by a gain, offset or delay, several times as far as those of any other log.

    With fewer than three logs nothing says what is usual. Of channels that predict each other, those count that still
    err when the others take no part. Where a command is in another unit, all channels follow it.
    """
    if len(comparison.pairs) < 3:
        return
    other, kinds, beyond = OtherLogs(comparison), comparison.kinds, find_far_references(comparison)
    unlike: dict[int, dict[int, tuple[float, str]]] = {}
    for log in (k for k, pair in enumerate(comparison.pairs) if pair.item.file not in beyond):
        each = ((c, other.explain_error(c, log)) for c in range(len(comparison.columns)))
        found = {c: one for c, one in each if one[0] > UNLIKE}
        moving = dict.fromkeys(kinds[list(found)])
        alone = {c: other.explain_error(c, log, [kind for kind in moving if kind != kinds[c]]) for c in found}
        kept = {c: one for c, one in alone.items() if one[0] > UNLIKE}
        if found and not kept:  # those of one kind with the one that is most unlike
            kind = kinds[max(found, key=lambda c: found[c][0])]
            kept = {c: one for c, one in found.items() if kinds[c] == kind}
        unlike |= {log: kept} if kept else {}
    if not unlike:
        return
    log = max(unlike, key=lambda log: sum(np.log(ratio) for ratio, _ in unlike[log].values()))
    found, file = unlike[log], comparison.pairs[log].item.file
    named = [c for c in sorted(found, key=lambda c: -found[c][0]) if found[c][1]][:1]
    named = "".join(f" ({comparison.columns[c]}: {found[c][1]})" for c in named)
    several = len(set(kinds[list(found)])) > 1
    question = "another robot" if several else "another unit, zero or clock, a clipped or dead channel, another robot"
    columns = list_few(comparison.columns[c] for c in sorted(found))
    yield f"{columns} of {file} do not follow from the other logs{named}: {question}?"


def drifting_clocks(comparison: Comparison) -> Iterator[str]:
    """The channels of one kind come ever later, or earlier, in one log, as those of no other log do."""
    if len(comparison.pairs) < 3:
        return
    other = OtherLogs(comparison)
    for kind in dict.fromkeys(comparison.kinds):
        slopes = [other.delay_slope(str(kind), log) for log in range(len(comparison.pairs))]
        for log, (slope, sure) in enumerate(slopes):
            rest = np.array([s for k, (s, _) in enumerate(slopes) if k != log])
            own = slope - np.median(rest)
            grows = abs(own) * len(other.rows[log])
            if sure > DRIFTING and grows > 1.0 and abs(own) > UNLIKE * np.abs(rest - np.median(rest)).max():
                file, word = comparison.pairs[log].item.file, "later" if own > 0.0 else "earlier"
                names = list_few(np.array(comparison.columns)[comparison.kinds == kind])
                yield (
                    f"{names} of {file} come ever {word}, by {grows:.2g} frames at its end ({1e6 * abs(own):.0f} ppm), "
                    "unlike in the other logs: a clock of its own?"
                )


CHECKS: tuple[Callable[[Comparison], Iterator[str]], ...] = (
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
