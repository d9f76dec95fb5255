"""Suspicious properties of a case that can still be diagnosed: a table of checks, each a function with its sentence.

Most compare a statistic of a measured channel with the nominal robot's; the last ones compare a log with the others.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from itertools import chain, combinations, pairwise, product
from textwrap import shorten

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from exodrake.core.confidence import ALPHA
from exodrake.core.errors import InputError
from exodrake.data.log import ORDER, fast_noise, robust_std
from exodrake.diagnosis.checks.compare import ABOVE, CLEAR, Channel, Comparison, find_step, list_few
from exodrake.engine.inputs import Reference
from exodrake.model.display import in_words
from exodrake.simulation.simulate import run, write_log

LONGEST = 300  # characters of a sentence
# Times what is usual, of the nominal robot or in the other logs: with few logs an error three times the largest is rare
# in any law without heavy tails, and healthy robots, simulated and real, stay below 2.7
BEYOND = 3.0
HALF = 0.5  # majority of a log's windows or of a variance; of noise, a signal-to-noise ratio of 1
ROUNDING = 1e-6  # of a column's motion over all logs: less is rounding
MATCH = 8  # frames in a row that are compared
HELD = 3  # samples in a row that count as held: noise repeats a rounded value now and then
SATURATED = 0.05  # of the samples: less hardly matters (assumed)
SPAN = 6.0  # standard deviations of noise between its largest and least values, about
WINDOW = 50  # frames in which the strength of a burst is taken (assumed)
USUAL = 0.9  # quantile over windows that counts as the usual strength: a burst is shorter than a tenth of a log
NOISIER = "vibration, or noisier sensors? Set"
QUIETER = "smoothed logs, or quieter sensors? If quieter, set"
LEAST_MOTION = 5.0  # motion over noise below which a signal says little: assumed
SEGMENT = 256  # samples of a spectrum: welch's own choice
ORDERS = (8, 16)  # differences that leave little of a loop that hunts: 0.14 and 0.01 of a period of 4 frames
WHITE = 1.2  # ratio of what differences of these orders say of noise that is white (assumed: half of a hunting loop's)
CHANGED = 0.1  # of the motion, by which repeats differ in gain or offset; lost packets and tremor stay below (assumed)
CLOSE = 0.5  # distance at which two states count as one, in standard deviations of the motion (assumed)
SMOOTH = 0.01  # white share up to which a channel tells the state: its noise moves a state by 0.14, less than CLOSE
APART = 1.5  # motions by which a log differs from the others in like states (assumed)
LONG = 25  # frames: what lasts shorter is neither a gap nor frozen (assumed: longer than packets are lost in a row)
ANOTHER_UNIT = 10.0**0.5  # times a limit; geometrically half-way to the smallest factor of another decimal unit
SMALL = 0.03  # of the motion: the scatter of nominal parameters; predictions are not trusted further
RIDGE = 1e-3  # of the variance: columns that move alike share their weight
BLOCKS = 10  # of a log, in each of which a delay is taken: the scatter about a line then says how sure its slope is
DRIFTING = 7.0  # standard errors of a slope; predictions err alike for long, so that healthy robots reach 6
ALONE = 0.75  # of an error, from which its cause is named


def suspicions(comparison: Comparison, improved: Callable[[], Comparison] | None = None) -> tuple[str, ...]:
    """Sentences on what is suspicious about a case, none for a good one, whatever effects its robot has.

    improved: the comparison with the improved robot of a diagnosis, which explains why logs differ if it does.
    """
    found = {check: [shorten(sentence, LONGEST) for sentence in check(comparison)] for check in CHECKS}
    if found[unlike_other_logs] and improved and not any(unlike_other_logs(improved())):
        found[unlike_other_logs] = []
    return tuple(sentence for said in found.values() for sentence in said)


def list_places(channels: Iterable[Channel]) -> str:
    """Columns and files of some channels, for a sentence."""
    listed = list(channels)
    return f"{list_few(c.column for c in listed)} of {list_few(c.file for c in listed)}"


def white_share(values: np.ndarray) -> float:
    """Share of a signal's (n,) variance that is white noise; von Neumann's ratio over 2, 0 for a constant."""
    variance = float(np.var(values))
    return float(np.mean(np.diff(values) ** 2)) / (2.0 * variance) if variance > 0.0 else 0.0


def find_runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts (runs,) and lengths (runs,) of the runs of equal values (n,)."""
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
    return starts, np.diff(starts, append=len(values))


def longest_run(values: np.ndarray) -> tuple[int, int]:
    """Start and length of the longest run of equal values (n,); of a mask, of the longest run that is set."""
    starts, lengths = find_runs(values)
    lengths = lengths * values[starts] if values.dtype == bool else lengths
    k = int(lengths.argmax())
    return int(starts[k]), int(lengths[k])


def nothing_held_out(comparison: Comparison) -> Iterator[str]:
    """A case holds no log out."""
    if not comparison.case.holdout_logs:
        yield f"{comparison.case.name}: no log is held out, so closure cannot be judged on motion the fit never saw"


def copied_logs(comparison: Comparison) -> Iterator[str]:
    """A log holds samples of another one, or these plus a constant, perhaps cut or shifted.

    Logs are compared by hashes of the changes in successive windows. Those that come once in each lie as far apart in
    a copy, wherever they are; coarse readings and motions that repeat have windows alike by chance.
    """
    logs = [np.column_stack([pair.measured, pair.reference]) for pair in comparison.pairs]
    spread = np.vstack(logs).std(axis=0)
    fine = ROUNDING * np.where(spread > 0.0, spread, 1.0)
    keys = np.random.default_rng(0).integers(1, 2**62, (len(fine), MATCH)) | 1
    prints = []
    for pair, log in ((p, log) for p, log in zip(comparison.pairs, logs, strict=True) if len(log) > MATCH):
        steps = np.rint(np.diff(log, axis=0) / fine).astype(np.int64)
        hashes = np.einsum("ncm,cm->n", sliding_window_view(steps, MATCH, axis=0), keys)
        found, first, count = np.unique(hashes, return_index=True, return_counts=True)
        once = (count == 1) & (found != 0)
        prints.append((pair.item, dict(zip(found[once].tolist(), first[once].tolist(), strict=True))))
    for (a, one), (b, other) in combinations(prints, 2):
        apart = Counter(other[window] - one[window] for window in one.keys() & other.keys())
        if max(apart.values(), default=0) > HALF * min(len(one), len(other)):
            roles = "so that nothing new is held out" if a.role != b.role else "so that it counts twice"
            yield f"{b.file} holds the samples of {a.file} (a constant apart), {roles}"


def another_unit(comparison: Comparison) -> Iterator[str]:
    """A channel has the shape of the nominal robot's, times -1, 57.3, 100, 1000 or their inverses."""
    for factor in dict.fromkeys(c.factor for c in comparison.channels if c.factor != 1.0):
        channels = [c for c in comparison.channels if c.factor == factor]
        yield f"{list_places(channels)} are about {factor:.3g} times what the nominal robot logs: another unit or sign?"


def references_beyond_limits(comparison: Comparison) -> dict[str, str]:
    """A command is far beyond the limits that the robot file states: sentence -> file. A measured motion has none."""
    machine, found = comparison.robot.machine, {}
    first = machine.references[0]
    try:
        limits = np.maximum(*map(np.abs, comparison.robot.reference_limits()))
    except InputError:  # not stated for each channel
        return {}
    columns, unit = machine.log_names([first]), machine.signal[first.signal].unit
    for pair in comparison.pairs if first.kind.endswith("_ref") else ():
        largest = np.abs(pair.reference[:, : len(columns)]).max(axis=0)
        ratios = np.divide(largest, limits, out=np.zeros_like(largest), where=limits > 0.0)
        if (worst := int(ratios.argmax())) in (beyond := np.flatnonzero(ratios > ANOTHER_UNIT)):
            found[
                f"{list_few(columns[k] for k in beyond)} of {pair.item.file}: another unit than {unit}? "
                f"{columns[worst]} reaches {largest[worst]:.4g} {unit}, the limit in the robot file is "
                f"{limits[worst]:.4g} {unit}"
            ] = pair.item.file
    return found


def exchanged_columns(comparison: Comparison) -> Iterator[str]:
    """Channels of one kind correlate clearly better with one another's simulation than with their own."""
    from scipy.optimize import linear_sum_assignment

    found = defaultdict[str, list[str]](list)  # exchanged columns in words -> files
    for pair, kind in product(comparison.pairs, dict.fromkeys(comparison.kinds)):
        own = np.flatnonzero(comparison.kinds == kind)
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation = np.corrcoef(pair.measured[:, own], pair.nominal[:, own], rowvar=False)[: len(own), len(own) :]
        positive = np.maximum(np.nan_to_num(correlation), 0.0)
        # share of a channel's variance that a nominal one leaves with a positive gain
        unexplained = np.log(np.clip(1.0 - positive**2, np.finfo(float).eps, 1.0))
        best = linear_sum_assignment(unexplained)[1]
        others = np.flatnonzero(best != np.arange(len(own)))
        left = unexplained[others, best[others]]
        clearly = len(others) and np.mean(unexplained[others, others] - left) > 2.0 * np.log(CLEAR)
        if clearly and left.max() < np.log(HALF):
            columns = np.array(comparison.columns)[own]
            found[list_few(f"{columns[k]} like {columns[best[k]]}" for k in others)].append(pair.item.file)
    for names, files in found.items():
        yield f"{names} of the nominal robot in {list_few(files)}: exchanged columns?"


def gaps(comparison: Comparison) -> Iterator[str]:
    """A column or a reference lacks samples for many frames in a row in which the log has others."""
    machine = comparison.robot.machine
    for log, file in ((pair.item.log, pair.item.file) for pair in comparison.pairs):
        references = [c for c in machine.log_names(machine.references) if log.has(c)]
        columns = [*comparison.columns, *references]
        missing = np.isnan(np.column_stack([log[c] for c in columns]))
        missing &= ~missing.all(axis=1, keepdims=True)  # frames that are absent whole are noted on reading
        for column, (start, length) in zip(columns, map(longest_run, missing.T), strict=True):
            if length >= LONG:
                held = "; the simulated robots hold the last one" if column in references else ""
                yield f"{column} of {file} has no samples for {length} frames from {log.time[start]:.6g} s on{held}"


def frozen_channels(comparison: Comparison) -> Iterator[str]:
    """A channel repeats one value for long while its noise, or what the other logs say of it, goes on.

    A robot that sticks or rests does so in other logs, too.
    """
    other, found = OtherLogs(comparison), []
    for column, name in enumerate(comparison.columns):
        values, nominals = ([getattr(p, x)[:, column] for p in comparison.pairs] for x in ("measured", "nominal"))
        if np.ptp(np.concatenate(values)) == 0.0:
            found += [f"{name} of every log"] if any(np.ptp(nominal) > 0.0 for nominal in nominals) else []
            continue
        expected = [other.predict(column, log) for log in range(len(values))]
        runs = [  # of one value, in each log: length, start, and the motion that is predicted
            [(n, s, np.std(predicted[s : s + n])) for s, n in zip(*find_runs(one)) if n >= LONG]
            for one, predicted in zip(values, expected, strict=True)
        ]
        for log in (k for k, own in enumerate(runs) if own):
            one, nominal, (n, start, own) = values[log], nominals[log], max(runs[log], key=lambda run: run[0])
            stuck = [moved for *_, moved in chain(*runs[:log], *runs[log + 1 :])]
            item, run = comparison.pairs[log].item, slice(start, start + n)
            rest, left = (np.delete(x, run) for x in (one, other.measured[log][:, column] - expected[log]))
            # of fewer than three logs, what the rest of this one leaves says how far to trust a prediction
            usual = other.errors(column, log) or [np.std(left) if len(left) else 0.0]
            frozen = own > BEYOND * max([SMALL, *stuck, *usual])
            # or the samples change all the time but in this run, which is no end of the range
            if len(rest) >= LONG and n >= BEYOND * max(longest_run(nominal)[1], longest_run(rest)[1]):
                outside = Channel(name, item.file, rest, np.delete(nominal, run))
                noisy = outside.carries_noise and outside.noise / outside.nominal_noise > 1.0 / CLEAR
                frozen |= noisy and one[start] not in (one.min(), one.max())
            if frozen:
                found.append(f"{name} of {item.file} from {item.log.time[start]:.6g} s on for {n} frames")
    if found:
        verb = "are" if len(found) > 1 else "is"
        yield f"{list_few(found)} {verb} frozen: one value repeats where the channel should move or be noisy"


def held_shares(values: np.ndarray, visits: int = 1) -> tuple[float, float]:
    """Shares of the samples (n,) that repeat for `HELD` rows or more: at ends of a motion's range, and elsewhere.

    visits: to an end, from which it counts.
    """
    starts, lengths = find_runs(values)
    held = (lengths >= HELD) & (len(starts) > 1)
    ends = [held & (values[starts] == end) for end in (values.min(), values.max())]
    at_ends = np.any([some & (some.sum() >= visits) for some in ends], axis=0)
    return lengths[at_ends].sum() / len(values), lengths[held & ~at_ends].sum() / len(values)


def clipped_channels(comparison: Comparison) -> Iterator[str]:
    """A channel stays at an end of its range again and again, far more than elsewhere and than the nominal robot's."""
    found = []
    for channel in comparison.channels:  # one visit is none: so looks a robot at rest, and a channel that died
        ends, elsewhere = held_shares(channel.measured, 2)
        # of the nominal one without its noise: it may rest there
        margin = SPAN * max(channel.nominal_noise, find_step(channel.nominal))
        low, high = channel.nominal.min() + margin, channel.nominal.max() - margin
        nominal = held_shares(np.clip(channel.nominal, low, high), 2)[0] if low < high else 1.0
        found += [channel] if ends > max(SATURATED, BEYOND * nominal, BEYOND * elsewhere) else []
    if found:
        yield f"{list_places(found)} again and again stay at one value at an end of their range: is the signal clipped?"


def nothing_moves(comparison: Comparison) -> Iterator[str]:
    """Over the logs to fit, neither a reference nor a compared channel moves by more than noise."""

    def moves(values: np.ndarray, rounding: float = 0.0) -> bool:
        return bool(np.ptp(values) > 0.0 and np.std(values) > LEAST_MOTION * max(fast_noise(values), rounding))

    pairs = [pair for pair in comparison.pairs if pair.item.role == "fit"]
    references, channels = (np.vstack([getattr(p, x) for p in pairs]).T for x in ("reference", "measured"))
    if not any(map(moves, references)) and not any(moves(values, find_step(values)) for values in channels):
        yield (
            "nothing moves in the logs to fit: the references are constant and no channel varies by more than "
            f"{LEAST_MOTION:g} times its noise, so hardly any effect can show; record a motion"
        )


def bursts(comparison: Comparison) -> Iterator[str]:
    """Fast noise is many times as strong as usual for a while in one channel alone, so not by a motion of the robot."""
    for pair in (p for p in comparison.pairs if len(p.measured) >= WINDOW / (1.0 - USUAL)):
        # fast noise in successive windows, single jumps apart: (measured and nominal, windows, channels)
        both = np.array([pair.measured, pair.nominal])[:, : len(pair.measured) // WINDOW * WINDOW]
        cut = both.reshape(2, -1, WINDOW, both.shape[-1])
        strength = np.median(np.abs(np.diff(cut, ORDER, axis=2)), axis=2)
        usual = np.quantile(strength, USUAL, axis=1).max(axis=0)
        measured, nominal = np.divide(strength, usual, out=np.zeros_like(strength), where=usual > 0.0)
        noisy = {c.column for c in comparison.channels if c.file == pair.item.file and c.carries_noise}
        for i, column in enumerate(comparison.columns):
            others = np.delete(measured, i, axis=1).max(axis=1, initial=1.0)
            times = measured[:, i] / np.maximum(others, nominal[:, i])
            if column in noisy and times.max() > BEYOND:
                time = pair.item.log.time[WINDOW * int(times.argmax())]
                place = f"{column} of {pair.item.file}"
                yield f"{place} has a burst of {times.max():.2g} times its usual noise at {time:.6g} s"


def noise_as_large_as_motion(comparison: Comparison) -> Iterator[str]:
    """More than half of a channel's variance is noise, by its whiteness or by its repeats, unlike the nominal robot."""
    found = [c for c in comparison.channels if white_share(c.measured) > max(HALF, CLEAR * white_share(c.nominal))]
    for column, repeated in product(comparison.columns, comparison.case.repeat_groups):
        channels = comparison.audible(column)
        runs, shares = [c for c in channels if c.file in [item.file for item in repeated]], []
        for name in ("measured", "nominal") if len(runs) > 1 else ():
            variance = sum(np.var(getattr(c, name)) for c in channels)
            first, last = (getattr(c, name) for c in (runs[0], runs[-1]))
            rows = min(len(first), len(last))
            noise = robust_std(first[:rows] - last[:rows]) ** 2 / 2.0
            shares.append(len(channels) * noise / variance if variance > 0.0 else 0.0)
        found += runs if shares and shares[0] > max(HALF, CLEAR * shares[1]) else []
    if found:
        yield f"noise is as large as the motion in {list_places(found)}: almost any cause would explain such a channel"


def noise_unlike_robot_file(comparison: Comparison) -> Iterator[str]:
    """The fast noise of all channels of a sensor is larger, or less, than the robot file says; what to set then.

    With a noisier sensor no explanation leaves as little as it should, with a quieter one a fit may look too good.
    """
    machine = comparison.robot.machine
    sensors = defaultdict[tuple[str, str, float], list[tuple[str, list[Channel]]]](list)
    for parameter, channels, repeats, word in compare_noise(comparison):
        sensors[".".join(parameter.split(".")[:2]), word, repeats].append((parameter, channels))
    for (name, word, repeats), found in sensors.items() if not any(noise_as_large_as_motion(comparison)) else ():
        columns = list(dict.fromkeys(c.column for _, channels in found for c in channels))
        unit = machine.signal[machine.column(columns[0].rsplit("_", 1)[0]).signal].unit
        levels = np.median([(c.noise, c.nominal_noise) for c in comparison.audible(columns[0])], axis=0)
        logged, stated, repeated = (in_words(float(level), unit) for level in (*levels, repeats))
        whole = len(found) == sum(p == name or p.startswith(f"{name}.") for p in machine.noise)
        between = f", between its runs {repeated}" if repeats else ""
        also = f" and {name.split('.')[0]}.repeatability" if repeats else ""
        yield (
            f"noise in the logs is {logged} in {list_few(columns)}, that of the nominal robot {stated}{between}: "
            f"{word} {name if whole else list_few(parameter for parameter, _ in found)}{also}"
        )


def compare_noise(comparison: Comparison) -> Iterator[tuple[str, list[Channel], float, str]]:
    """Noise parameters that the logs contradict, the channels that show it, repeatability, and what the noise may be.

    A parameter is `part.name` or `part.name.channel`. A sensor's noise is in every log; what is fast in one of them
    alone is its motion. A diagnosis counts the larger of noise and repeatability. What rounding hides is not judged.
    """
    machine = comparison.robot.machine
    for parameter in machine.noise:
        heard = [comparison.audible(name) for name in machine.heard_in(parameter) if name in comparison.columns]
        if not heard or not all(heard):
            continue
        repeats = f"{parameter.split('.')[0]}.repeatability"
        repeats = float(comparison.robot[repeats]) if repeats in machine.index else 0.0
        simulated = [[c.noise / c.least_noise for c in channels] for channels in heard]
        counted = [[c.noise / max(c.least_noise, repeats) for c in channels] for channels in heard]
        channels = [c for some in heard for c in some]
        if min(map(min, counted)) > ABOVE:
            yield parameter, channels, repeats, NOISIER
        elif max(map(np.median, simulated)) < 1.0 / ABOVE and min(map(np.median, counted)) < 1.0 / CLEAR:
            yield parameter, channels, repeats, QUIETER


def logged_noise(comparison: Comparison) -> dict[str, float]:
    """Noise parameters of sensors that are noisier in the logs than the robot file says -> noise that they show [SI].

    It is white, so that differences of two orders say the same of it, and it is in every channel of every log. That of
    a column that was filtered on import is what the case states.
    """
    machine, found = comparison.robot.machine, {}
    for parameter in machine.noise:
        stated = [comparison.case.noise[c] for c in machine.heard_in(parameter) if c in comparison.case.noise]
        if stated and max(stated) > ABOVE * comparison.robot[parameter]:
            found[parameter] = max(stated)
    for parameter, channels, _, word in compare_noise(comparison):
        high, higher = np.array([[fast_noise(c.measured / c.factor, k) for c in channels] for k in ORDERS])
        noise, least = np.minimum(high, higher), np.array([c.least_noise for c in channels])
        if word == NOISIER and (noise > ABOVE * least).all() and np.median(high / higher) < WHITE:
            found[parameter] = float(np.sqrt(comparison.robot[parameter] ** 2 + np.median(noise**2 - least**2)))
    for parameter, noise in motion_noise(comparison).items():
        own = found.get(parameter, comparison.robot[parameter])
        if (both := float(np.hypot(own, noise))) > ABOVE * own:
            found[parameter] = both
    return found


def motion_noise(comparison: Comparison) -> dict[str, float]:
    """Noise parameters of efforts that are predicted from recorded motion -> noise of the predicted ones [SI], RMS.

    That of a position is white. A filter makes the acceleration of it, whose response the spectra of both tell where
    the case does not state its noise, and the model says what that moves. None of a machine whose motion is not
    recorded.
    """
    machine, pairs = comparison.robot.machine, comparison.pairs
    squares = np.zeros(len(comparison.columns))

    def predict(rows: np.ndarray) -> np.ndarray:
        log = write_log(run(comparison.robot, Reference(rows), seed=None, quantisation=False))
        return np.column_stack([log[c] for c in comparison.columns])

    for pair in pairs if machine.motion else ():
        still = predict(pair.reference)
        for joint, places in machine.motion.items():
            moved, (position, acceleration) = pair.reference.copy(), pair.reference.T[places]
            noise = comparison.case.noise.get(f"acceleration_{joint}", 0.0)
            if noise := noise or fast_noise(position, ORDERS[0]) * response_rms(position, acceleration):
                moved[:, places[1]] += noise
                squares += np.mean((predict(moved) - still) ** 2, axis=0) / len(pairs)
    found = list(zip(comparison.columns, np.sqrt(squares).tolist(), strict=True))
    return {p: x for p in machine.noise for c, x in found if x and c in machine.heard_in(p)}


def response_rms(before: np.ndarray, after: np.ndarray) -> float:
    """RMS over all frequencies of the response of a filter by its input and output (n,), whose trends count little."""
    from scipy.signal import welch

    given, taken = (welch(np.diff(x, 2), nperseg=min(SEGMENT, len(x) - 2))[1] for x in (before, after))
    return float(np.sqrt(np.mean(taken / np.maximum(given, 1e-300))))


def changed_between_repeats(comparison: Comparison) -> Iterator[str]:
    """Repeats of one reference differ in gain or offset, by an F test and by more than a small part of the motion."""
    from scipy.special import fdtrc

    pairs = {pair.item.file: pair for pair in comparison.pairs}
    repeats = [(pairs[a.file], pairs[b.file]) for g in comparison.case.repeat_groups for a, b in pairwise(g)]
    found = defaultdict[tuple[str, str], list[str]](list)  # files of a repeat -> columns
    for (a, b), (i, column) in product(repeats, enumerate(comparison.columns)):
        n = min(len(a.measured), len(b.measured))
        difference, nominal = b.measured[:n, i] - a.measured[:n, i], a.nominal[:n, i]
        if np.std(nominal) == 0.0 or not difference.any():
            continue
        shape = (nominal - nominal.mean()) / np.std(nominal)
        change = np.array([difference.mean(), (difference * shape).mean()])
        rest = np.sum((difference - change[0] - change[1] * shape) ** 2) / (n - 2)
        p = float(fdtrc(2, n - 2, n * np.mean(change**2) / rest)) if rest > 0.0 else 0.0
        motion = max(np.std(a.measured[:, i]), np.std(a.nominal[:, i]))
        if np.abs(change).max() > CHANGED * motion and p < ALPHA / (len(repeats) * len(comparison.columns)):
            found[a.item.file, b.item.file].append(column)
    for (a, b), columns in found.items():
        names = list_few(columns)
        yield f"{names} changed in gain or offset from {a} to its repeat {b}: another robot, or one that changed?"


def logs_of_other_robots(comparison: Comparison) -> Iterator[str]:
    """A log differs from the others in states that count as one by more than a channel moves.

    Frames are paired by the nearest state. Causes that the diagnosis knows stay below: they act alike in one state, up
    to its history.
    """
    from scipy.spatial import KDTree

    pairs, found = comparison.pairs, defaultdict[str, list[str]](list)  # column -> files
    reference, measured, nominal = (
        np.vstack([getattr(p, x) for p in pairs]) for x in ("reference", "measured", "nominal")
    )
    log = np.repeat(np.arange(len(pairs)), [len(pair.measured) for pair in pairs])
    smooth = [i for i, both in enumerate(zip(measured.T, nominal.T)) if max(map(white_share, both)) < SMOOTH]
    state = np.hstack([reference, nominal[:, smooth]])
    state = state[:, np.ptp(state, axis=0) > 0.0]
    if len(pairs) < 2 or not state.shape[1]:
        return
    state = state / state.std(axis=0)
    residual, motion = measured - nominal, np.maximum(measured.std(axis=0), nominal.std(axis=0))
    for k, pair in enumerate(pairs):
        mine, others = np.flatnonzero(log == k), np.flatnonzero(log != k)
        distance, nearest = KDTree(state[others]).query(state[mine], distance_upper_bound=CLOSE)
        close = np.isfinite(distance)
        if close.sum() >= 4 * LONG:  # fewer frames are one state, not like motion
            apart = np.abs(np.median(residual[mine[close]] - residual[others[nearest[close]]], axis=0))
            for i in (i for i in smooth if apart[i] > APART * motion[i]):
                found[comparison.columns[i]].append(pair.item.file)
    for column, files in found.items():
        place = f"{column} of {list_few(files)}"
        yield f"{place} differs from the other logs by more than its motion in like states: another robot?"


# column -> how many times as large as usual its error is, and whether by gain, offset or delay alone, in words
Errors = dict[int, tuple[float, str]]


class OtherLogs:
    """Predictions of the channels of each log by linear models of the other logs.

    From references, what the nominal robot does on them, and channels of other kinds. An effect of the robot acts on
    all logs and so is in the model, as far as it is linear; what is wrong with one log is not.
    Columns are references, nominal and measured ones about their median means, in units of their typical motion, that
    of a measured one no less than the nominal's. Logs on one reference predict each other too well and do not count.
    """

    def __init__(self, comparison: Comparison) -> None:
        self.comparison, self.kinds, width = comparison, comparison.kinds, len(comparison.columns)
        raw = [np.hstack([p.reference, p.nominal, p.measured]) for p in comparison.pairs]
        spread, largest = np.median([rows.std(axis=0) for rows in raw], axis=0), np.vstack(raw).std(axis=0)
        spread[-width:] = np.maximum(spread[-width:], spread[-2 * width : -width])
        scale = np.where(spread > ROUNDING * largest, spread, np.where(largest > 0.0, largest, 1.0))
        middle = np.median([rows.mean(axis=0) for rows in raw], axis=0)
        rows = [np.column_stack([np.ones(len(one)), (one - middle) / scale]) for one in raw]
        self.rows, self.moments = rows, np.array([one.T @ one / len(one) for one in rows])
        self.scale, self.middle = scale[-width:], middle[-width:]  # of measured columns
        self.measured = [one[:, -width:] for one in rows]
        self.nominal = [(pair.nominal - self.middle) / self.scale for pair in comparison.pairs]
        references, self.repeats = [pair.reference for pair in comparison.pairs], np.eye(len(raw), dtype=bool)
        for (i, a), (k, b) in combinations(enumerate(references), 2):
            n, tolerance = min(len(a), len(b)), 1e-9 * float(np.abs(a).max(initial=1e-9))
            self.repeats[i, k] = self.repeats[k, i] = np.allclose(a[:n], b[:n], rtol=0.0, atol=tolerance)

    def fit_weights(self, column: int, logs: Sequence[int], without: Collection[str] = ()) -> np.ndarray:
        """Weights (1 + c,) that predict a column, fitted on some logs; without: kinds that take no part, as its own."""
        first = self.moments.shape[1] - len(self.kinds)
        used = np.r_[:first, first + np.flatnonzero(~np.isin(self.kinds, [self.kinds[column], *without]))]
        moments, ridge = self.moments[list(logs)].mean(axis=0), np.r_[0.0, np.full(len(used) - 1, RIDGE)]
        found = np.zeros(len(moments))
        found[used] = np.linalg.solve(moments[np.ix_(used, used)] + np.diag(ridge), moments[used, first + column])
        return found

    def error(self, column: int, log: int, logs: Sequence[int], without: Collection[str] = ()) -> float:
        """RMS error of a column of a log by a fit on some logs [motions]."""
        off = -self.fit_weights(column, logs, without)
        off[column - len(self.kinds)] += 1.0
        return float(np.sqrt(max(off @ self.moments[log] @ off, 0.0)))

    def errors(self, column: int, log: int, without: Collection[str] = ()) -> list[float]:
        """Errors of a column in each other log, by fits that know neither of both; none with fewer than three logs."""
        logs = np.arange(len(self.rows))
        known = {k: logs[(logs != log) & ~self.repeats[k]] for k in map(int, logs[logs != log])}
        return [self.error(column, k, list(some), without) for k, some in known.items() if len(some)]

    def predict(self, column: int, log: int, without: Collection[str] = ()) -> np.ndarray:
        """A column of a log (n,) by a fit on the others; the nominal robot's where there is no other."""
        others = [k for k in range(len(self.rows)) if k != log]
        return self.rows[log] @ self.fit_weights(column, others, without) if others else self.nominal[log][:, column]

    def find_errors(self, log: int, columns: Iterable[int], without: Collection[str] = ()) -> Errors:
        """Errors of columns of a log that a gain, an offset or a delay explains.

        What none of them explains is left to the robot: an effect may show in one motion alone.
        """
        from scipy.signal import correlate

        found, others = {}, [k for k in range(len(self.rows)) if k != log]
        for column in columns:
            kinds = {*without} - {self.kinds[column]}
            errors, rms = self.errors(column, log, kinds), self.error(column, log, others, kinds)
            usual = max([SMALL, *errors])
            if not errors or rms <= BEYOND * usual:
                continue
            level = self.middle[column] / self.scale[column]
            unit = self.comparison.pairs[log].item.log.units[self.comparison.columns[column]]
            h, y = self.predict(column, log, kinds), self.measured[log][:, column]
            error, n, true = y - h, len(y), h + level
            far = n // 4
            correlation = correlate(y - y.mean(), h - h.mean(), method="fft")
            late = int(np.argmax(correlation[n - 1 - far : n + far])) - far
            gain = float(true @ (y + level) / (true @ true))
            both = np.column_stack([h, np.ones(n)])
            left = {
                f"about {gain:.3g} times what they say": error - (gain - 1.0) * true,
                f"{error.mean() * self.scale[column]:+.3g} {unit} apart": error - error.mean(),
                f"{late * self.comparison.case.period:+.3g} s late": y - h[np.clip(np.arange(n) - late, 0, n - 1)],
                "": error - both @ np.linalg.lstsq(both, error, rcond=None)[0],  # gain and offset
            }
            shares = {words: 1.0 - float(rest @ rest / (error @ error)) for words, rest in left.items()}
            best = max(filter(None, shares), key=lambda words: shares[words])
            ratio = rms * float(np.sqrt(max(shares[best], shares[""], 0.0))) / usual
            if ratio > BEYOND:
                found[column] = ratio, best if shares[best] > ALONE else ""
        return found

    def delay_slope(self, kind: str, log: int) -> tuple[float, float]:
        """By how much the delay of a kind of channel grows in a log [frames/frame], and that over its standard error.

        In each block of the log the error is fitted by offset, gain and delay; a line goes through the delays.
        """
        found = []
        for column in map(int, np.flatnonzero(self.kinds == kind)):
            predicted = self.predict(column, log)
            error = self.measured[log][:, column] - predicted
            speed = np.gradient(np.convolve(np.pad(predicted, 2, mode="edge"), np.ones(5) / 5.0, "valid"))
            for block in np.array_split(np.arange(len(predicted)), BLOCKS):
                if len(block) < LONG or not np.ptp(speed[block]) > 0.0:
                    continue
                shape = np.column_stack([np.ones(len(block)), predicted[block] - predicted[block].mean(), speed[block]])
                inverse = np.linalg.pinv(shape.T @ shape)
                fitted = inverse @ (shape.T @ error[block])
                left = np.mean((error[block] - shape @ fitted) ** 2)
                if inverse[2, 2] > 0.0 and left > 0.0:
                    found.append((block.mean(), -fitted[2], 1.0 / (inverse[2, 2] * left)))
        if len(found) < BLOCKS // 2 or len({time for time, *_ in found}) < 2:
            return 0.0, 0.0
        time, delay, weight = np.array(found).T
        time, delay = (x - np.average(x, weights=weight) for x in (time, delay))
        spread = float(weight @ time**2)
        slope = float(weight @ (time * delay)) / spread
        error = np.sqrt(weight @ (delay - slope * time) ** 2 / (len(time) - 2) / spread)
        return slope, abs(slope) / float(error) if error > 0.0 else 0.0


def unlike_other_logs(comparison: Comparison) -> Iterator[str]:
    """Channels of one log err by a gain, offset or delay, several times as far as those of any other log.

    With fewer than three logs nothing says what is usual. Of channels that predict each other, those count that still
    err when the others take no part. Where a command is in another unit, all channels follow it.
    """
    if len(comparison.pairs) < 3:
        return
    other, kinds, beyond = OtherLogs(comparison), comparison.kinds, references_beyond_limits(comparison).values()
    unlike: dict[int, Errors] = {}
    for log in (k for k, pair in enumerate(comparison.pairs) if pair.item.file not in beyond):
        if found := other.find_errors(log, range(len(kinds))):
            worst = kinds[max(found, key=lambda c: found[c][0])]
            kept = other.find_errors(log, found, kinds[list(found)])
            unlike[log] = kept or {c: one for c, one in found.items() if kinds[c] == worst}
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
        slopes, sure = np.array([other.delay_slope(kind, log) for log in range(len(comparison.pairs))]).T
        for log, pair in enumerate(comparison.pairs):
            rest = np.delete(slopes, log)
            own = slopes[log] - np.median(rest)
            grows = abs(own) * len(pair.measured)
            if sure[log] > DRIFTING and grows > 1.0 and abs(own) > BEYOND * np.abs(rest - np.median(rest)).max():
                names = list_few(np.array(comparison.columns)[comparison.kinds == kind])
                when = "later" if own > 0.0 else "earlier"
                yield (
                    f"samples of {names} in {pair.item.file} come ever {when}, by {grows:.2g} "
                    f"frames at its end ({1e6 * abs(own):.0f} ppm), unlike in the other logs: a clock of its own?"
                )


CHECKS: tuple[Callable[[Comparison], Iterable[str]], ...] = (
    nothing_held_out, copied_logs, another_unit, references_beyond_limits, exchanged_columns, gaps, frozen_channels,
    clipped_channels, nothing_moves, bursts, noise_as_large_as_motion, noise_unlike_robot_file,
    changed_between_repeats, logs_of_other_robots, unlike_other_logs, drifting_clocks,
)  # fmt: skip
