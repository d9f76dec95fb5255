"""A case as a regression: measured signals in units of their noise, and simulated logs of given robots.

A `Trial` is one log of the case as arrays. A `Detection` is an effect that a detector found in the logs before any fit.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import product

import numpy as np
from numba import njit

from exodrake.core.errors import InputError
from exodrake.core.parallel import side_by_side
from exodrake.data.case import EXPERIMENT, Case, CaseLog
from exodrake.data.log import fill_columns
from exodrake.diagnosis.checks.compare import check_case, compare, find_columns, without_short_logs
from exodrake.diagnosis.checks.suspicions import find_runs, logged_noise
from exodrake.diagnosis.noise import Bands, noise_std, reference_rows, without
from exodrake.diagnosis.result import NamedEffect
from exodrake.effects import LIBRARY
from exodrake.engine.compose import compile_machine
from exodrake.engine.inputs import NOTHING, NoiseInputs, RunOptions, input_rows, prepare_values
from exodrake.model.machine import Machine, signal_count, state_size
from exodrake.model.robot import Robot
from exodrake.simulation.simulate import delay_columns

ROWS = 4  # robots simulated at once: their records stay in the cache
# s without a row after which the robot may be anywhere until it has settled, and s that this takes; assumed
GAP, SETTLED = 0.1, 2.0
STILL = 0.02  # of a channel's largest speed: below it the channel counts as at rest; assumed
TURN = 0.05  # s beside rest in which dry friction turns round; as long as a low-pass of 10 Hz blurs that. Assumed
# of what a sensor shows, the most that it drifts by, and the least time that it takes for it [s]: as the library has it
# of offsets; temperatures take minutes. Assumed
DRIFT, MINUTE = 0.3, 60.0
GENERIC = ("signal", "sliding", "joint")  # blocks of the library whose laws serve any machine
NEGLIGIBLE = 0.3  # noise standard deviations RMS beyond noise, in every channel: a smaller gap is none, by default
# residuals are clipped here [noise_std], or where a signal would have to be as large again as the recorded one, if that
# is more: a diverging candidate is bad, not infinite
WILD = 1e4


@dataclass(frozen=True, eq=False)
class Trial:
    """One log of a case as arrays."""

    name: str  # file of the log
    reference: np.ndarray  # (n, references) [SI]
    measured: np.ndarray  # (n, columns) [SI], NaN where missing
    latent: Mapping[str, np.ndarray] = field(default_factory=dict)  # inputs decoded from the log -> (n, channels)
    # (n, channels) logged inputs and outputs that correct a run (`Machine.observer`), if they do
    follow: np.ndarray = field(default_factory=lambda: NOTHING)
    whole: bool = False  # no part of it may be left out: the motion was designed to tell explanations apart

    def count_frames(self, share: float) -> int:
        """Number of frames of the first part of the log, two at least; all of one that is used whole."""
        return len(self.reference) if self.whole else max(2, int(share * len(self.reference)))

    def shorten(self, share: float) -> Trial:
        """That part."""
        n = self.count_frames(share)
        return replace(self, reference=self.reference[:n], measured=self.measured[:n], follow=self.follow[:n])


@dataclass(frozen=True)
class Detection:
    """An effect that a detector found."""

    effect: NamedEffect  # effect as the answer states it
    # parameter name -> value [SI] that all further robots have; none for an effect that remains a candidate of the fits
    values: dict[str, float]
    reason: str  # how it was found, in one sentence
    # draws what a log shows of the effect beyond its simulation, by the problem, the parameters (parameters,) of a
    # robot, a trial and a random generator: (n, columns) [SI]. None if the simulation shows it all
    noise: Callable[[Problem, np.ndarray, Trial, np.random.Generator], np.ndarray] | None = None

    @property
    def certain(self) -> bool:
        """Whether the effect is there, whatever a fit finds."""
        return bool(self.values)


@dataclass(frozen=True, eq=False)
class Problem:
    """Trials of a case, the columns that are compared, and their noise standard deviations."""

    robot: Robot  # nominal, with the case's overrides, and the noise that the logs show where that is larger
    columns: tuple[str, ...]  # (c,) names
    noise_std: np.ndarray  # (c,) [unit of the column]
    fit: tuple[Trial, ...]  # repeats of a fitted trial serve the noise only
    holdout: tuple[Trial, ...]
    case: Case
    notched: Bands = ()  # bands [Hz] that are filtered out of all residuals
    tried: frozenset[str] = frozenset()  # ids of the effects that the diagnosis tries
    detected: tuple[Detection, ...] = ()
    negligible: float = NEGLIGIBLE  # a gap that is smaller in every channel is none
    # noise parameters that the logs showed to be larger -> value in the robot file [SI]
    noisier: Mapping[str, float] = field(default_factory=dict)

    @property
    def stated(self) -> Robot:
        """The nominal robot with the noise of its file."""
        return self.robot.with_parameters(self.noisier)

    @property
    def judged(self) -> tuple[Trial, ...]:
        """Trials that the closure is measured on: held-out ones, else those that were fitted."""
        return self.holdout or self.fit

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each column: its name without the channel."""
        return tuple(column.rsplit("_", 1)[0] for column in self.columns)

    @property
    def counted(self) -> dict[str, float]:
        """Effects that were decoded instead of fitted -> value of their first parameter."""
        return {d.effect.id: next(iter(d.effect.parameters.values())).value for d in self.detected if not d.certain}

    @cached_property
    def wild(self) -> np.ndarray:
        """Residuals (c,) at which a column is clipped [noise_std]."""
        sizes = [np.nanmax(np.abs(trial.measured), axis=0, initial=0.0) for trial in (*self.fit, *self.holdout)]
        return np.maximum(WILD, 2.0 * np.max(sizes, axis=0) / self.noise_std)

    @cached_property
    def signal_indices(self) -> list[int]:
        """Indices of the columns in the flat vector of signals."""
        machine, starts = self.robot.machine, self.robot.machine.offsets
        names = [(c, enumerate(machine.log_names([c]), starts[c.signal].start)) for c in machine.columns]
        places = {name: k for _, numbered in names for k, name in numbered}
        return [places[column] for column in self.columns]

    def predict(self, rows: np.ndarray, trial: Trial, seed: int | None = None) -> np.ndarray:
        """Logs (rows, n, columns) [SI] that robots would write, infinite of one that comes to divide by zero.

        rows: (rows, parameters) flat parameter vectors [SI]. trial: reference and latent inputs. seed: of the noise.
        """
        records = self.records(rows, trial, seed)
        with np.errstate(invalid="ignore"):
            return delay_columns(self.robot.machine, records, self.signal_indices)

    def records(
        self, rows: np.ndarray, trial: Trial, seed: int | None = None, ends: np.ndarray | None = None
    ) -> np.ndarray:
        """All signals (rows, n, signals) [SI] of the runs of `predict`, with the same arguments.

        ends: (rows, states) that gets the states at their ends.
        """
        machine, n = self.robot.machine, len(trial.reference)
        noise_inputs = NoiseInputs.draw(n, seed, machine)
        noise_inputs |= {name: values[:n] for name, values in trial.latent.items()}
        given = input_rows(machine, trial.reference, noise_inputs).values()
        records = np.full((len(rows), n, signal_count(machine)), np.inf)  # what a run leaves that ends early
        options, module = RunOptions(follow=trial.follow), compile_machine(machine)
        rows = np.ascontiguousarray(rows)

        def run(k: int) -> None:
            w, state = np.zeros(signal_count(machine)), np.zeros(state_size(machine)) if ends is None else ends[k]
            with suppress(ZeroDivisionError):
                module.begin(rows[k], state)
                module.run(rows[k], state, w, *given, machine.slot, 1, records[k], *options)

        side_by_side([partial(run, k) for k in range(len(rows))])
        return records

    def residual(self, rows: np.ndarray, trials: tuple[Trial, ...]) -> np.ndarray:
        """Residuals (rows, samples) of parameter vectors `rows` (rows, parameters), all trials and columns in a row.

        They are (measured - simulated) / noise_std, 0 where nothing was measured, without the notched bands.
        """
        out = np.empty((len(rows), sum(trial.measured.size for trial in trials)))
        side_by_side(self.tasks(rows, trials, out, np.asarray))
        return out

    def tasks(
        self,
        rows: np.ndarray,
        trials: tuple[Trial, ...],
        out: np.ndarray,
        whitening: Callable[[np.ndarray], np.ndarray],
    ) -> list[Callable[[], None]]:
        """Tasks that fill `out` (rows, samples) with residuals (rows, n, columns) of a trial, whitened."""

        def fill(some: slice, trial: Trial, here: slice) -> None:
            found = self.predict(rows[some], trial)
            subtract(found, trial.measured, self.noise_std, self.wild)
            found = whitening(without(self.notched, found, self.robot.machine.frame))
            found[:, np.isnan(trial.measured)] = 0.0
            out[some, here] = found.reshape(len(found), -1)

        ends = np.cumsum([trial.measured.size for trial in trials])
        chunks = [slice(k, k + ROWS) for k in range(0, len(rows), ROWS)]
        places = [(t, slice(end - t.measured.size, end)) for t, end in zip(trials, ends, strict=True)]
        return [partial(fill, some, *place) for place in places for some in chunks]

    def without(self, bands: Bands) -> Problem:
        """The problem with bands [Hz] filtered out of residuals and noise standard deviations."""
        left = noise_std(self.case, self.robot, self.columns, bands)
        return replace(self, notched=bands, noise_std=np.minimum(left, self.noise_std))

    def shorten(self, share: float) -> Problem:
        """The problem with the first part of each fitted trial, for cheap comparisons."""
        return replace(self, fit=tuple(t.shorten(share) for t in self.fit))

    @property
    def settling(self) -> float:
        """Frames at the starts of all fitted logs that do not count (`Machine.settling`)."""
        return len(self.fit) * self.robot.machine.settling / self.robot.machine.frame

    def prediction_error(self) -> Problem | None:
        """The problem with runs that follow what was measured where the machine says so (`Machine.observer`).

        Errors do not go round the loop, nor does noise. None where the columns for it are missing.
        """
        machine, kinds = self.robot.machine, np.array(self.kinds)
        if machine.observer is None:
            return None
        followed = machine.observer.measured_input, machine.observer.output
        columns = [np.flatnonzero(kinds == kind) for kind in followed]
        if any(len(k) < max(machine.column_width(kind), 1) for k, kind in zip(columns, followed, strict=True)):
            return None
        kept = kinds != followed[0]

        def follow(trial: Trial) -> Trial:
            known = fill_columns(trial.measured[:, np.concatenate(columns)])
            return replace(trial, measured=trial.measured[:, kept], follow=known)

        return replace(
            self,
            columns=tuple(np.array(self.columns)[kept].tolist()),
            noise_std=self.noise_std[kept],
            fit=tuple(map(follow, self.fit)),
            holdout=tuple(map(follow, self.holdout)),
        )

    def silent(self, robot: Robot | None = None) -> np.ndarray:
        """Flat parameter vector for prediction: no noise, no rounding, with the effects that were detected."""
        values, machine = prepare_values(robot or self.robot, quantisation=False), self.robot.machine
        detected = {name: value for d in self.detected for name, value in d.values.items()}
        for name, value in (dict.fromkeys(machine.noise, 0.0) | detected).items():
            values[machine.index[name]] = value
        return values


def by_trial(rows: np.ndarray, trials: tuple[Trial, ...]) -> list[np.ndarray]:
    """A stacked residual (samples,) cut into one (n, columns) for each trial."""
    ends = np.cumsum([trial.measured.size for trial in trials])[:-1]
    return [part.reshape(t.measured.shape) for part, t in zip(np.split(rows, ends), trials, strict=True)]


@njit(cache=True, nogil=True)
def subtract(simulated: np.ndarray, measured: np.ndarray, noise_std: np.ndarray, most: np.ndarray) -> None:
    """Turns simulated signals (rows, n, columns), in place, into (measured - simulated) / noise_std, `most` at most.

    Where nothing was measured the difference goes on in a straight line, so that filters see no steps.
    """
    n = measured.shape[0]
    for row in simulated:
        for c in range(measured.shape[1]):
            last = -1  # sample that was measured
            for t in range(n):
                if np.isnan(measured[t, c]):
                    continue
                difference = (measured[t, c] - row[t, c]) / noise_std[c]
                row[t, c] = -most[c] if np.isnan(difference) else min(max(difference, -most[c]), most[c])
                begin = row[last, c] if last >= 0 else row[t, c]
                for k in range(last + 1, t):
                    row[k, c] = begin + (row[t, c] - begin) * (k - last) / (t - last)
                last = t
            for k in range(last + 1, n):
                row[k, c] = row[last, c] if last >= 0 else 0.0


def list_required(machine: Machine) -> tuple[str, ...]:
    """Column kinds that a log of the machine must have: its references, and what the table requires."""
    return tuple(dict.fromkeys(c.kind for c in machine.columns if c.required))


def make_problem(
    case: Case, robot: Robot, tried: frozenset[str] | None = None, negligible: float | None = None
) -> Problem:
    """The regression of a case.

    Args:
        case: logs; repeats of a trial in its session count for the noise only. Without repeats, sensors are as noisy as
            the robot file says or as the logs show, whichever is more. Logs that are too short are left out. A missing
            reference keeps its last value, in a missing row it goes on in a straight line.
        robot: nominal robot.
        tried: ids of the effects to try; by default all that are not `not_tried`.
        negligible: noise standard deviations RMS beyond noise; a gap that is smaller in every channel is none.

    Raises:
        InputError: where `check_case` has one, and where all fitted logs are too short or at rest.
    """
    robot = robot.with_parameters(case.robot, source=case.name) if case.robot else robot
    check_case(case, robot.machine)
    case = without_short_logs(case, robot.machine)
    noise = {} if case.repeat_groups else logged_noise(compare(case, robot))
    noisier = {name: robot[name] for name in noise}
    robot = robot.with_parameters(noise, source="the logs") if noise else robot
    columns = find_columns(case, robot.machine)
    starts = [c.kind for c in robot.machine.references]
    # columns whose first value in a log is where the simulation starts
    is_start = [f"{column.rpartition('_')[0]}_start" in starts for column in columns]
    # place of a column of efforts, which about rest are whatever dry friction holds and count as missing -> column of
    # its speed, and the least that counts
    resting = dict[int, tuple[str, float]]()
    for i, (kind, _, channel) in enumerate(column.rpartition("_") for column in columns):
        if kind in robot.machine.resting:
            name = f"{robot.machine.resting[kind]}_{channel}"
            speeds = [np.abs(item.log[name]) for item in case.fit_logs if name in item.log.signals]
            resting[i] = name, STILL * max((np.nanmax(speed, initial=0.0) for speed in speeds), default=0.0)

    def make_trial(item: CaseLog) -> Trial:
        reference, measured = reference_rows(robot.machine, item.log), np.column_stack([item.log[c] for c in columns])
        gone = np.isnan(reference).any(axis=1) & np.isnan(measured).all(axis=1)
        reference, at = fill_columns(reference), np.arange(len(gone))
        if gone.any() and not gone.all():
            reference = np.column_stack([np.interp(at, at[~gone], column[~gone]) for column in reference.T])
        for start, rows in zip(*find_runs(gone)):  # until it has settled after a gap
            if gone[start] and rows * robot.machine.frame > GAP:
                measured[start : start + rows + round(SETTLED / robot.machine.frame)] = np.nan
        measured[0, is_start] = measured[: round(robot.machine.settling / robot.machine.frame)] = np.nan
        for i, (speed, least) in resting.items():
            if speed in item.log.signals:
                measured[find_turns(item.log[speed], least, round(TURN / robot.machine.frame)), i] = np.nan
        return Trial(item.file, reference, measured, whole=item.protocol == EXPERIMENT)

    fit = tuple(make_trial(item) for item in case.fit_logs if not case.is_copy(item))
    holdout = tuple(map(make_trial, case.holdout_logs))
    if still := [trial.name for trial in (*fit, *holdout) if np.isnan(trial.measured).all()]:
        note = f"left out, since no sample counts (rows are missing, joints rest or turn round): {', '.join(still)}"
        case = replace(case, notes=(*case.notes, note))
        fit, holdout = (tuple(trial for trial in some if trial.name not in still) for some in (fit, holdout))
        if not fit:
            raise InputError(f"{case.name}: no fitted log is left: {note}")
    return Problem(
        robot,
        columns,
        noise_std(case, robot, columns),
        fit=fit,
        holdout=holdout,
        case=case,
        tried=frozenset(e.id for e in robot.machine.effects if not e.not_tried) if tried is None else tried,
        negligible=NEGLIGIBLE if negligible is None else negligible,
        noisier=noisier,
    )


def find_turns(speed: np.ndarray, least: float, frames: int) -> np.ndarray:
    """Mask (n,) of samples at which a joint rests or turns round, and of so many beside them.

    At most a quarter of the motion in which a moving sample lies on average. speed: (n,), of which a smaller one than
    `least` is rest.
    """
    direction = np.where(np.abs(speed) < least, 0.0, np.sign(speed))
    starts, rows = find_runs(direction)
    starts, rows = starts[direction[starts] != 0.0], rows[direction[starts] != 0.0]
    found, frames = direction == 0.0, min(frames, int(np.sum(rows**2) // max(4 * np.sum(rows), 1)))
    for start, end in zip(starts, starts + rows, strict=True):
        found[start : start + frames] = found[max(start, end - frames) : end] = True
    return found


def choose_tried(machine: Machine, only: Sequence[str] = (), without: Sequence[str] = ()) -> frozenset[str]:
    """Ids of the effects that a diagnosis shall try; InputError for an unknown id, or where nothing is left.

    only: also of effects that are `not_tried` by default; empty: the default ones. without: ids to leave out.
    """
    named = {identity: machine.effect(identity) for identity in (*only, *without)}
    default = [effect.id for effect in machine.effects if not effect.not_tried]
    tried = frozenset(only or default) - set(without)
    if not tried:
        raise InputError(f"no effect is left to try without {', '.join(named)}")
    return tried


def measure_sizes(machine: Machine, case: Case) -> dict[str, float]:
    """Largest value of the recorded signals by unit [SI]: travel of lengths and angles, size of efforts and rates.

    Of what is measured, not of what is commanded, lengths and angles have rates, too: those that a twentieth exceed,
    since counts and lost rows make single ones large.
    """
    found, signals = dict[str, float](), defaultdict[str, list[np.ndarray]](list)
    for column in machine.columns:
        names = [name for name in machine.log_names([column]) if "start" not in name]
        recorded = [item.log[name] for item in case.fit_logs for name in names if item.log.has(name)]
        unit = column.unit or machine.signal[column.signal].unit
        signals[unit] += recorded
        if unit in ("rad", "m") and column.signal not in machine.inputs:
            rates = [np.abs(np.diff(values)) / machine.frame for values in recorded]
            signals[f"{unit}/s"] += [np.nanquantile(rate, [0.95]) for rate in rates if np.isfinite(rate).any()]
    for unit, recorded in signals.items():
        values = [each[np.isfinite(each)] for each in recorded]
        sizes = [np.ptp(each) if unit in ("rad", "m") else np.abs(each).max() for each in values if len(each)]
        found[unit] = float(max(sizes, default=0.0))
    for force, per in product(("N m", "N"), ("rad", "m")):
        if found.get(force) and found.get(per):
            rates = [np.diff(values) / machine.frame for values in signals[per]]
            speed = np.concatenate([rate[np.isfinite(rate)] for rate in rates]) + 1e-12
            found[f"{force}/{per}"] = found[force] / found[per]
            found[f"{force} s/{per}"] = found[force] / np.sqrt(np.mean(speed**2))
    for force, per, inertia in (("N m", "rad/s2", "kg m2"), ("N", "m/s2", "kg")):
        if found.get(force) and found.get(per):
            found[inertia] = found[force] / np.sqrt(np.nanmean(np.concatenate(signals[per]) ** 2))
    return found


def with_recorded_ranges(robot: Robot, case: Case) -> Robot:
    """The robot whose generic effects may be as large as the recording shows, and its numbers of rest as small.

    An effect is generic if it is a law of any signal, slide or servo whose range the library does not state for it.
    Such ranges follow from a typical motion (`Part.scales`). A recording knows better: friction is no larger than the
    largest effort, play no larger than the travel. A reading drifts by no more than `DRIFT` of it in the longest log,
    or in a minute. So ranges are only widened, but for limits of what moves less than they begin at. A limit of speed
    is first sought at the largest measured one: one beyond shows nothing, one far below would have kept it smaller.
    Before that all ranges are those of a robot of this size (`Machine.sizes`).
    """
    machine, size, values = robot.machine, measure_sizes(robot.machine, case), robot.values.copy()
    longest = machine.frame * max((len(item.log) for item in case.fit_logs), default=0)
    for name, largest in machine.recorded.items():
        values[machine.index[name]] = min(values[machine.index[name]], largest(size))
    laws, effects = {id(f) for e in LIBRARY.values() if e.block in GENERIC for f in e.at.values()}, []
    larger = machine.sizes(robot) if machine.sizes else {}
    for effect in machine.effects:
        generic, stated = {id(function) for function in effect.at.values()} <= laws, LIBRARY.get(effect.id)
        first, *others = (p.resize(larger[p.unit], p.unit) if p.unit in larger else p for p in effect.parameters)
        limit, rate = first.transform == "reciprocal", first.unit.endswith("/s")
        part = 0.5 if limit and not rate else 1.0  # a limit either way is half of a travel
        reach = part * size.get(first.unit, 0.0)
        if effect.family == "drift":
            reach = DRIFT * size.get(first.unit.removesuffix("/s"), 0.0) / max(longest, MINUTE)
        known = not generic or (stated and stated.parameters == effect.parameters)
        widens = (limit and rate) or (first.transform == "linear" and first.null == 0.0)
        if not known and ((widens and 0.0 < first.high < reach) or (limit and 0.0 < reach < first.low)):
            wide = first.resize(reach / first.high, first.unit)
            low = wide.low if limit or first.low <= 0.0 else first.low
            first = replace(wide, high=reach, low=low, default=reach if limit else wide.default)
        effects.append(replace(effect, parameters=(first, *others)))
    widened = machine if tuple(effects) == machine.effects else replace(machine, effects=tuple(effects))
    return replace(robot, values=values, machine=widened)
