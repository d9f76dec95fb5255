"""What can be said of a case before its diagnosis: recordings, excitation, suspicions, identifiability.

Identifiability: the effects that the motion of a case could show, and those that it could not tell apart, were all its
signals logged by the nominal robot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from exodrake.core.progress import no_progress
from exodrake.data.case import Case, read_case
from exodrake.data.formats import read_table
from exodrake.data.log import Log, fast_noise
from exodrake.data.plot import STYLE, new_figure, render_png
from exodrake.diagnosis.calibration import calibration_notes
from exodrake.diagnosis.checks.compare import compare, list_few
from exodrake.diagnosis.checks.suspicions import HELD, LEAST_MOTION, held_shares, suspicions
from exodrake.diagnosis.fit import Explanation
from exodrake.diagnosis.likelihood import duration, output_error
from exodrake.diagnosis.linear import LinearModel, minimise_bounded
from exodrake.diagnosis.linearise import Linearisation, linearise, nominal_jacobian
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem, list_required, make_problem
from exodrake.diagnosis.search import LAW
from exodrake.model.display import percent
from exodrake.model.machine import Column, Machine
from exodrake.model.part import Signal
from exodrake.model.robot import Robot

JITTER = 0.1  # of a frame by which rows may be off without a word: assumed
DRIFT = 1e-4  # relative error of a clock: crystals keep 100 ppm
POWER = 0.95  # of the motion's variance, below the frequency that is stated
SMALL = 0.1  # of the span between the limits: less motion shows little
REVERSALS = 4  # fewer show neither play nor friction: assumed
LISTED = 2  # rivals that are named
CEILING = 1000.0  # standard deviations; what stands out further is as clear as can be
CLEAR, MISTAKEN, HIDDEN = "distinguished", "could be mistaken", "not seen"
COLOURS = {CLEAR: "#009e73", MISTAKEN: "#e69f00", HIDDEN: "#b0b7bf"}
SEEN = 4.0  # standard deviations; that of one test among a hundred effects and channels at 0.3 % (normal law)
STRETCH = (0.0, 1.5)  # by which a direction that was simulated at one size only may be scaled: assumed
# of the case that are simulated for each direction, and s of it where frames are short, after what does not count; they
# stand for all, so that a check takes seconds
FRAMES, SECONDS = 1500, 5.0
SENSOR = 5e-4  # noise of a sensor not there yet, as a share of its signal's span: assumed, an encoder of 12 bits
EXTRA = "also"  # kind of the columns of such sensors


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


class Direction(NamedTuple):
    """An effect of typical size on one channel."""

    effect: str
    channel: str  # "" for an effect of the whole robot
    unit: str  # of the effect's first parameter
    typical: float  # value of that parameter [unit]
    seen: float  # how far the logs change [standard deviations]
    smallest: float  # value that could just be seen [unit], within the plausible range; NaN where sizes do not scale
    taken_for: dict[str, float]  # effects that could be taken for it -> share of the change that they leave

    @property
    def state(self) -> str:
        """What the logs would do of it: `CLEAR`, `MISTAKEN` or `HIDDEN`."""
        return HIDDEN if self.seen < SEEN else MISTAKEN if self.taken_for else CLEAR


class Sensor(NamedTuple):
    """A signal that is not logged, and identifiability if it were, with some noise [its unit]."""

    signal: Signal
    noise: float
    left: Identifiability


class Identifiability(NamedTuple):
    """Identifiability of effects from the references and columns of a case."""

    directions: tuple[Direction, ...]
    sensors: tuple[Sensor, ...] = ()  # signals whose measurement would help most, best first
    fewer: Mapping[tuple[str, ...], Identifiability] = {}  # by kinds of columns: one less, and each alone

    def select(self, state: str) -> list[Direction]:
        """Directions of a state."""
        return [d for d in self.directions if d.state == state]


class Preflight(NamedTuple):
    """Checks of a case before its diagnosis."""

    case: Case
    clocks: tuple[Clock, ...]
    channels: tuple[ChannelQuality, ...]
    excitations: tuple[Excitation, ...]
    identifiability: Identifiability
    problems: tuple[str, ...]  # sentences; none for a good case


def preflight(
    path: str | Path, robot: Robot, tried: frozenset[str] | None = None, allow_outside: bool = False,
    progress: Callable[[str], object] = no_progress,
) -> Preflight:  # fmt: skip
    """Checks a case, a folder or a log, before its diagnosis; InputError where that has one.

    tried: ids of the effects that it would try; its own choice by default. allow_outside: whether logs may lie outside
    the folder. progress: called with what is done.
    """
    machine = robot.machine
    recorded = read_case(path, list_required(machine), machine.frame, allow_outside)
    progress("comparing the logs with the nominal robot")
    problem = make_problem(recorded, robot, tried)
    robot, case = problem.stated, problem.case  # without logs that are too short
    comparison = compare(case, robot)
    place = Path(path) if Path(path).is_dir() else Path(path).parent
    # as recorded, before they are mended
    clocks = tuple(judge_clock(read_table(place / item.file), item.file, machine.frame) for item in case.logs)
    channels, logs = [], [pair.item.log for pair in comparison.pairs]
    whole = [~np.isnan(np.column_stack(list(log.signals.values()))).all(axis=1) for log in logs]
    for i, column in enumerate(comparison.columns):
        measured = [pair.measured[:, i] for pair in comparison.pairs]
        missing = np.concatenate([np.isnan(log[column]) & rows for log, rows in zip(logs, whole, strict=True)])
        motion, rows = np.std(np.concatenate(measured)), [len(values) for values in measured]
        held = np.average([held_shares(values)[0] for values in measured], weights=rows)
        noise = np.median([fast_noise(values) for values in measured if len(values) > 2 * HELD] or [0.0])
        channels.append(ChannelQuality(column, *map(float, (missing.mean(), held, motion, noise))))
    excitations, names = [], machine.log_names(machine.references[:1])
    limited = machine.reference_limits and robot.limits
    spans = np.subtract(*robot.reference_limits()[::-1]) if limited else np.full(len(names), np.nan)
    for name, most in zip(names, spans.tolist(), strict=True):
        moves = [item.log[name][np.isfinite(item.log[name])] for item in case.fit_logs]
        signs = [np.sign(np.diff(values)) for values in moves]
        turns = sum(int((np.diff(one[one != 0.0]) != 0.0).sum()) for one in signs)
        span, rest = float(np.ptp(np.concatenate(moves))), float(np.mean(np.concatenate(signs) == 0.0))
        band = max(find_band(values, machine.frame) for values in moves)
        excitations.append(Excitation(name, span, span / most, band, turns, rest))
    found = find_problems(clocks, channels, excitations)
    problems = dict.fromkeys([*case.notes, *found, *suspicions(comparison), *calibration_notes(machine)])
    result = identifiability(problem, progress)
    return Preflight(case, clocks, tuple(channels), tuple(excitations), result, tuple(problems))


def find_problems(
    clocks: Sequence[Clock], channels: Sequence[ChannelQuality], excitations: Sequence[Excitation]
) -> Iterator[str]:
    """A sentence for each problem of clocks, channels and excitation."""
    for c in clocks:
        if c.jitter > JITTER:
            yield f"{c.file}: steps of the clock scatter by {percent(c.jitter)} of a frame"
        if abs(c.drift) > DRIFT + 3.0 * c.jitter / c.rows:  # both ends of the log are as uncertain
            word = "slowly" if c.drift > 0.0 else "fast"
            yield f"{c.file}: its rows come {abs(1e6 * c.drift):.0f} ppm too {word}"
    for c in channels:
        if 0.0 < c.motion < LEAST_MOTION * c.noise:
            yield f"{c.column} moves by only {c.motion / c.noise:.1f} times its noise"
    for e in excitations:
        if e.span == 0.0:
            yield f"{e.column} never moves, so its channel shows no friction, play, lag or gain"
            continue
        if e.share < SMALL:
            yield f"{e.column} uses {percent(e.share)} of the span between its limits"
        if e.reversals < REVERSALS:
            yield f"{e.column} reverses too seldom ({e.reversals}) to show play and friction"


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


def find_band(values: np.ndarray, frame: float) -> float:
    """Frequency [Hz] below which most of the variance of a signal (n,) lies; 0 for one that rests."""
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    if not power.sum() > 0.0:
        return 0.0
    return float(np.fft.rfftfreq(len(values), frame)[int(np.searchsorted(np.cumsum(power) / power.sum(), POWER))])


def identifiability(whole: Problem, progress: Callable[[str], object] = no_progress) -> Identifiability:
    """Identifiability of the effects that a case tries from its references and columns."""
    problem = plan_experiment(whole)
    machine = problem.robot.machine
    effects = [effect for effect in machine.effects if effect.id in problem.tried]
    nominal = nominal_parameters(problem.robot)
    progress(f"simulating {len(effects)} effects")
    likelihood, values, x = output_error(problem), problem.silent(), np.zeros(len(nominal))
    (residual,) = likelihood.residual(values[None])
    bare = Explanation((), nominal, x, values, residual, np.zeros((len(nominal), 0)))
    jacobian = nominal_jacobian(likelihood, bare)
    lin = linearise(likelihood, values, effects, residual)
    progress("telling the effects apart")
    # a linear model of nominal parameters and, last, directions, with a block for each kind of column
    kinds, known = np.array(problem.kinds), list(dict.fromkeys(problem.kinds))
    kind = np.concatenate([np.tile(kinds, len(trial.measured)) for trial in problem.fit])
    blocks = [(0, 0, np.flatnonzero(kind == k)) for k in known]
    memory = likelihood.memory * duration(problem) / duration(whole)  # the simulated frames stand for all
    model = LinearModel.with_directions(bare, jacobian, lin.directions, blocks, memory)

    def with_kinds(some: Sequence[str]) -> Identifiability:
        gram = model.eliminate(len(nominal), np.isin(known, some)).normal
        return Identifiability(find_directions(lin, machine, gram))

    own = [k for k in known if not k.startswith(EXTRA)]
    found, sensors = with_kinds(own), []
    for k in known[len(own) :]:
        better, noise = with_kinds([*own, k]), float(problem.noise_std[kinds == k].max())
        if len(better.select(CLEAR)) > len(found.select(CLEAR)):
            sensors.append(Sensor(machine.signal[machine.column(k).signal], noise, better))
    sensors.sort(key=lambda sensor: (-len(sensor.left.select(CLEAR)), len(sensor.left.select(HIDDEN))))
    # one kind of sensor less, and each alone; a command that is logged is no sensor, and stays
    removable = [k for k in own if machine.observer is None or k != machine.observer.measured_input]
    sets = [tuple(k for k in own if k != gone) for gone in removable]
    sets += [tuple(k for k in own if k == kept or k not in removable) for kept in removable]
    fewer = {some: with_kinds(some) for some in dict.fromkeys(sets)} if len(removable) > 1 else {}
    return found._replace(sensors=tuple(sensors), fewer=fewer)


def plan_experiment(problem: Problem) -> Problem:
    """The problem as an experiment: logs that the nominal robot would give, with every signal in them."""
    machine, noise, own = problem.robot.machine, sensor_noise_std(problem.robot), len(problem.columns)
    logged = {c.signal for c in machine.columns if c.kind in problem.kinds}
    written = {name for part in machine.parts for output in part.outputs for name in output.writes}
    more = [s for s in machine.signals if s.name in written - logged]
    extra = tuple(Column(EXTRA + s.name.replace("_", ""), s.name, required=False) for s in more)
    wide = replace(machine, columns=machine.columns + extra, nominal=None)
    columns, robot = (*problem.columns, *machine.log_names(extra)), replace(problem.robot, machine=wide)
    frames = max(FRAMES, SECONDS / machine.frame) + problem.settling
    short = problem.shorten(min(1.0, frames / sum(len(t.reference) for t in problem.fit)))
    every, logs = replace(short, robot=robot, columns=columns, holdout=()), []
    for trial in short.fit:
        (simulated,) = every.predict(every.silent()[None], trial)
        simulated[:, :own][np.isnan(trial.measured)] = np.nan
        logs.append(simulated)
    kinds = {c.signal: c.kind for c in machine.columns}
    span = np.max([np.ptp(np.nan_to_num(log), axis=0) for log in logs], axis=0)[own:]
    levels = np.array([noise.get(kinds.get(s.name, ""), 0.0) for s in more for _ in machine.axes.of(s.axis)])
    stated = np.concatenate([problem.noise_std, np.where(levels > 0.0, levels, SENSOR * span)])
    keep = (np.arange(len(stated)) < own) | ((stated > 0.0) & np.isfinite(stated))
    fit = tuple(replace(t, measured=log[:, keep]) for t, log in zip(short.fit, logs, strict=True))
    return replace(every, columns=tuple(np.array(columns)[keep].tolist()), noise_std=stated[keep], fit=fit)


def find_directions(lin: Linearisation, machine: Machine, gram: np.ndarray) -> tuple[Direction, ...]:
    """All effects of typical size on each channel, by the products (directions, directions) of what they change.

    An effect changes the logs by a direction d [noise_std], nominal parameters free within their tolerances, and is
    seen where |d| exceeds `SEEN`. Another one, of directions D, can be taken for it where min |d - D f| over its range
    of f is below `SEEN` or the error `LAW` of a law times |d|.
    """
    found, size = [], np.sqrt(np.maximum(np.diag(gram), 0.0))
    # what any sizes of a probe's directions leave of each direction (probes, directions)
    unit, least = gram / np.maximum(np.outer(size, size), 1e-12), np.zeros((len(lin.probes), len(gram)))
    for left, rows in zip(least, (probe.rows for probe in lin.probes)):
        imitated = unit[rows] * (np.linalg.pinv(unit[np.ix_(rows, rows)], 1e-8, hermitian=True) @ unit[rows])
        left[:] = size * np.sqrt(np.maximum(1.0 - imitated.sum(axis=0), 0.0))
    for effect in dict.fromkeys(p.effect for p in lin.probes):
        info, probes = machine.effect(effect).parameters[0], [p for p in lin.probes if p.effect == effect]
        others = np.array([p.effect != effect for p in lin.probes])
        # the directions at the modest amplitude: of each channel where their sizes scale, else of the typical probe
        scaled = next((probe for probe in probes if probe.scaled), None)
        if scaled is not None and scaled.parameters[scaled.scaled[0]].channels != ("",):
            typical = [(int(row), scaled, k) for row, k in zip(scaled.rows, scaled.scaled, strict=True)]
        else:
            probe = min(probes, key=lambda p: abs(p.x[0] - p.parameters[0].start))
            typical = [(int(probe.rows[0]), probe, 0)]
        for row, probe, k in typical:
            parameter, x, seen = probe.parameters[k], float(probe.x[k]), float(size[row])
            channel = parameter.channels[0] if probe is scaled and len(parameter.channels) == 1 else ""
            smallest, taken, most = float("nan"), dict[str, float](), max(SEEN, LAW * seen)
            if probe.scaled and seen > 0.0:  # no weaker than plausible
                ends = [parameter.coordinate(end) for end in (info.low, info.high)]
                weakest = min(map(abs, ends)) if ends[0] * ends[1] > 0.0 else 0.0
                smallest = parameter.value(float(np.copysign(max(abs(x) * SEEN / seen, weakest), x)))
            near = np.flatnonzero(others & (least[:, row] < most)) if seen >= SEEN else []
            for rival in (lin.probes[i] for i in sorted(near, key=lambda i: least[i, row])):
                low, high = (rival.low, rival.high) if rival.scaled else np.array(STRETCH)[:, None]
                _, gain = minimise_bounded(gram[np.ix_(rival.rows, rival.rows)], -gram[rival.rows, row], low, high)
                rest = float(np.sqrt(max(gram[row, row] + 2.0 * gain, 0.0)))
                if rest < most:
                    taken[rival.effect] = min(taken.get(rival.effect, 1.0), rest / seen)
            taken = dict(sorted(taken.items(), key=lambda item: item[1]))
            found.append(Direction(effect, channel, info.unit, parameter.value(x), seen, smallest, taken))
    return tuple(found)


def draw_figure(found: Preflight) -> bytes:
    """The change of the logs by each effect, a mark for each channel, and what it could be taken for, as PNG."""
    import matplotlib

    result = found.identifiability
    effects = list(dict.fromkeys(d.effect for d in result.directions))
    with matplotlib.rc_context(STYLE):
        figure = new_figure(10.0, 1.9 + 0.2 * max(len(effects), 8))
        axes, beside = figure.subplots(1, 2, width_ratios=(1.0, 0.9), sharey=True)
        for state, colour in COLOURS.items():
            own = result.select(state)
            seen, rows = [min(max(d.seen, 0.1), CEILING) for d in own], [effects.index(d.effect) for d in own]
            axes.plot(seen, rows, "o", color=colour, ms=5, label=state, alpha=0.85)
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
            for other, share in (i for d in result.directions if d.effect == effect for i in d.taken_for.items()):
                left[other] = min(share, left.get(other, 1.0))
            words = [f"{other} ({percent(share)})" for other, share in sorted(left.items(), key=lambda item: item[1])]
            beside.text(0.0, row, list_few(words, LISTED), va="center", fontsize=7.5, color="#8a5a00")
        figure.suptitle(f"{found.case.name}: what it could tell", fontsize=11, fontweight="bold", x=0.01, ha="left")
        return render_png(figure)
