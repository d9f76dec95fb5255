"""Everything that can be said of a case before its diagnosis: recordings, excitation, suspicions, identifiability."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from exodrake.core.progress import no_progress
from exodrake.core.robot import Robot
from exodrake.data.case import FILE, Case, find_logs, read_case, read_case_file
from exodrake.data.formats import read_table
from exodrake.data.log import Log
from exodrake.data.plot import STYLE, new_figure, png_of
from exodrake.diagnosis.calibration import calibration_notes
from exodrake.diagnosis.checks.compare import Comparison, check_case, compare, fast_noise, find_runs
from exodrake.diagnosis.checks.identifiability import SEEN, Identifiability, identifiability
from exodrake.diagnosis.checks.suspicions import HELD, LEAST_MOTION, suspicions
from exodrake.diagnosis.problem import columns_of, required_of

JITTER = 0.1  # of a frame by which rows may be off without a word: assumed
DRIFT = 1e-4  # relative error of a clock: crystals keep 100 ppm
POWER = 0.95  # of the motion's variance, below the frequency that is stated
SMALL = 0.1  # of the span between the limits: less motion shows little
REVERSALS = 4  # fewer show neither play nor friction: assumed
LISTED = 2  # rivals that are named
CEILING = 1000.0  # standard deviations; what stands out further is as clear as can be
COLOURS = {"distinguished": "#009e73", "could be mistaken": "#e69f00", "not seen": "#b0b7bf"}


class Clock(NamedTuple):
    """The clock of one log as recorded."""

    file: str
    rows: int
    duration: float  # [s]
    step: float  # median step [s]
    jitter: float  # standard deviation of the steps over the step, gaps left out
    drift: float  # relative difference of the mean step, gaps left out, from the machine's frame
    missing: int  # frames without a row


class ChannelQuality(NamedTuple):
    """A compared column over all logs."""

    column: str
    missing: float  # share of samples that are missing in rows that are there
    saturated: float  # share of samples that stay at an end of the range
    motion: float  # standard deviation [SI]
    noise: float  # standard deviation of fast noise [SI]


class Excitation(NamedTuple):
    """Excitation by a channel of the machine's first reference, over the logs to fit."""

    column: str
    span: float  # largest minus smallest value [SI]
    share: float  # of the span between the robot file's limits; NaN without limits
    band: float  # frequency below which most of its variance lies [Hz]
    reversals: int  # changes of direction
    rest: float  # share of frames in which it does not move


class Preflight(NamedTuple):
    """Checks of a case before its diagnosis."""

    case: Case
    clocks: tuple[Clock, ...]
    channels: tuple[ChannelQuality, ...]
    excitations: tuple[Excitation, ...]
    identifiability: Identifiability
    problems: tuple[str, ...]  # sentences; none for a good case


def preflight(
    path: str | Path,
    robot: Robot,
    tried: frozenset[str] | None = None,
    allow_outside: bool = False,
    progress: Callable[[str], object] = no_progress,
) -> Preflight:
    """Checks a case before its diagnosis.

    Args:
        path: case folder or log.
        robot: nominal robot.
        tried: ids of the effects that a diagnosis would try; its own choice by default.
        allow_outside: whether logs may lie outside the folder.
        progress: called with what is done.

    Raises:
        InputError: where a diagnosis has one.
    """
    case = read_case(path, required_of(robot.machine), robot.machine.frame, allow_outside)
    robot = robot.with_parameters(case.robot, source=case.name) if case.robot else robot
    check_case(case, robot.machine)
    columns_of(case, robot.machine)
    progress("comparing the logs with the nominal robot")
    comparison = compare(case, robot)
    parts = read_clocks(Path(path), robot.machine.frame), judge_channels(comparison), judge_excitation(case, robot)
    problems = (*case.notes, *find_problems(*parts), *suspicions(comparison), *calibration_notes(robot.machine))
    return Preflight(case, *parts, identifiability(case, robot, tried, progress), tuple(dict.fromkeys(problems)))


def find_problems(
    clocks: Sequence[Clock], channels: Sequence[ChannelQuality], excitations: Sequence[Excitation]
) -> Iterator[str]:
    """A sentence for each problem of clocks, channels and excitation."""
    for c in clocks:
        if c.jitter > JITTER:
            yield f"{c.file}: steps of the clock scatter by {c.jitter:.0%} of a frame"
        if abs(c.drift) > DRIFT + 3.0 * c.jitter / c.rows:  # both ends of the log are as uncertain
            word = "slowly" if c.drift > 0.0 else "fast"
            yield f"{c.file}: its rows come {abs(1e6 * c.drift):.0f} ppm too {word}"
        if c.missing:
            yield f"{c.file}: {c.missing} of {c.rows + c.missing} frames are missing"
    for c in channels:
        if 0.0 < c.motion < LEAST_MOTION * c.noise:
            yield f"{c.column} moves by only {c.motion / c.noise:.1f} times its noise"
    for e in excitations:
        if e.span == 0.0:
            yield f"{e.column} never moves, so its channel shows no friction, play, lag or gain"
            continue
        if e.share < SMALL:
            yield f"{e.column} uses {e.share:.0%} of the span between its limits"
        if e.reversals < REVERSALS:
            yield f"{e.column} turns {e.reversals} times: play and friction need reversals"


def read_clocks(path: Path, frame: float) -> tuple[Clock, ...]:
    """Clocks of all logs of a case folder, or of one log, before they are mended."""
    place = path.parent if path.name == FILE else path
    if not place.is_dir():
        return (judge_clock(read_table(path), path.name, frame),)
    entries = read_case_file(place / FILE)["logs"] if (place / FILE).is_file() else find_logs(place)[0]
    return tuple(judge_clock(read_table(place / entry["file"]), entry["file"], frame) for entry in entries)


def judge_clock(log: Log, file: str, frame: float) -> Clock:
    """The clock of a log as recorded, against frames of `frame` [s]."""
    steps = np.diff(log.time)
    steps = steps[steps > 0.0]
    if not len(steps):
        return Clock(file, len(log), 0.0, float("nan"), 0.0, 0.0, 0)
    count = np.maximum(np.rint(steps / frame), 1.0)
    single, total = steps[count == 1.0], int(count.sum())
    jitter = float(np.std(single)) / frame if len(single) else 0.0
    drift = float(steps.sum()) / total / frame - 1.0
    return Clock(file, len(log), float(np.ptp(log.time)), float(np.median(steps)), jitter, drift, total - len(steps))


def judge_channels(comparison: Comparison) -> tuple[ChannelQuality, ...]:
    """Quality of each compared column, over all logs."""
    found, logs = [], [pair.item.log for pair in comparison.pairs]
    whole = [~np.isnan(np.column_stack(list(log.signals.values()))).all(axis=1) for log in logs]
    for i, column in enumerate(comparison.columns):
        measured = [pair.measured[:, i] for pair in comparison.pairs]
        missing = [np.isnan(log[column]) & rows for log, rows in zip(logs, whole, strict=True)]
        lost, held = (float(np.mean(np.concatenate(masks))) for masks in (missing, list(map(find_held, measured))))
        noise = [fast_noise(values) for values in measured if len(values) > 2 * HELD]
        motion, fast = float(np.std(np.concatenate(measured))), float(np.median(noise)) if noise else 0.0
        found.append(ChannelQuality(column, lost, held, motion, fast))
    return tuple(found)


def find_held(values: np.ndarray) -> np.ndarray:
    """Samples (n,) that stay at the smallest or largest value for `HELD` rows or more, those of a motion only."""
    starts, lengths = find_runs(values)
    at_ends = np.isin(values[starts], (values.min(), values.max())) & (len(starts) > 1)
    return np.repeat(at_ends & (lengths >= HELD), lengths)


def judge_excitation(case: Case, robot: Robot) -> tuple[Excitation, ...]:
    """Excitation of each channel by the machine's first reference, over the logs to fit."""
    machine, found = robot.machine, []
    spans = np.subtract(*robot.reference_limits()[::-1]) if machine.reference_limits and robot.limits else None
    for k, name in enumerate(machine.log_names(machine.references[:1])):
        logs = [item.log[name][np.isfinite(item.log[name])] for item in case.fit_logs]
        moves = [np.sign(np.diff(one)) for one in logs]
        turns = sum(int((np.diff(one[one != 0.0]) != 0.0).sum()) for one in moves)
        span = float(np.ptp(np.concatenate(logs)))
        share = span / float(spans[k]) if spans is not None else float("nan")
        band = max(find_band(one, machine.frame) for one in logs)
        found.append(Excitation(name, span, share, band, turns, float(np.mean(np.concatenate(moves) == 0.0))))
    return tuple(found)


def find_band(values: np.ndarray, frame: float) -> float:
    """Frequency [Hz] below which most of the variance of a signal (n,) lies; 0 for one that rests."""
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    if not power.sum() > 0.0:
        return 0.0
    return float(np.fft.rfftfreq(len(values), frame)[int(np.searchsorted(np.cumsum(power) / power.sum(), POWER))])


def draw_figure(found: Preflight) -> bytes:
    """The change of the logs by each effect, a mark for each channel, and what it could be taken for, as PNG."""
    import matplotlib

    result = found.identifiability
    effects = list(dict.fromkeys(d.effect for d in result.directions))
    with matplotlib.rc_context(STYLE):
        figure = new_figure(10.0, 1.9 + 0.2 * max(len(effects), 8))
        axes, beside = figure.subplots(1, 2, width_ratios=(1.0, 0.9), sharey=True)
        groups = (result.clear, result.mistaken, result.hidden)
        for (word, colour), own in zip(COLOURS.items(), groups, strict=True):
            seen, rows = [min(max(d.seen, 0.1), CEILING) for d in own], [effects.index(d.effect) for d in own]
            axes.plot(seen, rows, "o", color=colour, ms=5, label=word, alpha=0.85)
        axes.axvline(SEEN, color="#555", lw=0.9, ls=(0, (4, 2)))
        axes.set_xscale("log")
        axes.set_xlim(0.08, 1.4 * CEILING)
        axes.set_yticks(range(len(effects)), effects, fontsize=7.5)
        axes.set_ylim(len(effects) - 0.5, -0.5)
        axes.set_xlabel("change of the logs by an effect of typical size\n[noise standard deviations]")
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, handletextpad=0.2, columnspacing=1.0)
        beside.set_axis_off()
        beside.set_title("could be taken for (share of the change left)", fontsize=9, loc="left")
        for row, effect in enumerate(effects):
            left: dict[str, float] = {}
            for direction in (d for d in result.directions if d.effect == effect):
                for other, share in direction.taken_for.items():
                    left[other] = min(share, left.get(other, 1.0))
            words = [f"{other} ({share:.0%})" for other, share in sorted(left.items(), key=lambda item: item[1])]
            more = f" and {len(words) - LISTED} more" if len(words) > LISTED else ""
            beside.text(0.0, row, ", ".join(words[:LISTED]) + more, va="center", fontsize=7.5, color="#8a5a00")
        figure.suptitle(f"{found.case.name}: what it could tell", fontsize=11, fontweight="bold", x=0.01, ha="left")
        return png_of(figure)
