"""Replay: each segment between measured wires is fed what was measured, so that it does not inherit an error from
upstream.

The measured wires cut a machine into segments (`Machine.segments`). What lies between two measured wires cannot be told
apart by replay; of the Exo-Index loop:

    controller   tension -> speed command        motor    speed command, tension -> stroke  (bus, drive, encoder)
    tendon       stroke, angle -> tension (cell) finger   tension -> angle     (sheath, finger, motion capture)

A segment is *fixed* by putting the measured output in place of the simulated one; the Shapley share of a segment is its
average part in the fall of the gap over all orders of fixing, exact over all subsets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from math import factorial

import numpy as np

from exodrake.compiled.inputs import NoiseInputs, Reference, input_rows
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.loop import Loop
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.simulation.simulate import record
from exodrake.systems import tendon_finger

WINDOW, ORDER = 7, 2  # frames and order of the Savitzky-Golay filter that smooths what is fed in
LONGEST, MOST = 8.0, 1500  # s and frames of a trial that are replayed: the loop is interpreted
READING = 0.005  # s after the start of a frame: middle of the three bus reads


def smoothed(rows: np.ndarray) -> np.ndarray:
    """What is fed into a segment (n, channels): gaps filled, noise and encoder steps smoothed."""
    from scipy.signal import savgol_filter

    whole = filled_columns(rows)
    return np.asarray(savgol_filter(whole, WINDOW, ORDER, axis=0)) if len(whole) > WINDOW else whole


def measured_of(problem: Problem, trial: Trial, kind: str) -> np.ndarray:
    """Columns of one kind (n, channels)."""
    return trial.measured[:, [k == kind for k in problem.kinds]]


def replayed(problem: Problem, values: np.ndarray, trial: Trial, fixed: frozenset[str]) -> np.ndarray:
    """Log columns (n, columns) [SI] with the segments `fixed` overruled by what was measured."""
    machine = problem.robot.machine
    loop = Loop(machine, values)
    feeds = {s: smoothed(measured_of(problem, trial, machine.segments[s])) for s in fixed}
    run_frame = exo_frame if tendon_finger.PART in machine.parts else plain_frame
    if "tendon" in fixed:
        loop.soften()
    rows, rates = np.zeros_like(trial.measured), {s: np.gradient(f, machine.frame, axis=0) for s, f in feeds.items()}
    shown = {c.kind: c.signal for c in machine.columns}
    given = input_rows(machine, trial.reference, NoiseInputs.draw(len(trial.reference), None, machine))
    for frame in range(len(trial.reference)):
        for name, values_now in given.items():
            loop.signals[name][:] = values_now[frame]
        run_frame(loop, frame, feeds, rates)
        for i, column in enumerate(problem.columns):
            kind, channel = column.rsplit("_", 1)
            channels = machine.axes.of(machine.signal[shown[kind]].axis)
            rows[frame, i] = loop.signals[shown[kind]][channels.index(channel)]
    return rows


def plain_frame(loop: Loop, frame: int, feeds: dict[str, np.ndarray], rates: dict[str, np.ndarray]) -> None:
    """A frame in which each fixed segment's wire takes its measured value."""
    machine = loop.machine
    shown = {c.kind: c.signal for c in machine.columns}
    imposed = {shown[machine.segments[s]]: f[frame] for s, f in feeds.items()}
    for slot in range(machine.slots):
        loop.tick(machine.slot, imposed, None, None)
        loop.tasks(slot, imposed)


def exo_frame(loop: Loop, frame: int, feeds: dict[str, np.ndarray], rates: dict[str, np.ndarray]) -> None:
    """A frame of the tendon-driven finger: its wires are stiff, so that a measured tension acts as a force and a
    measured angle as a hold.
    """
    machine = loop.machine
    for slot in range(machine.slots):
        later = (slot + 0.5) * machine.slot - READING
        now = {s: f[frame] + later * rates[s][frame] for s, f in feeds.items()}
        imposed = {"stroke": now["motor"], "wire_speed": rates["motor"][frame]} if "motor" in now else {}
        if "tendon" in now:
            imposed["tension"] = np.maximum(now["tendon"], 0.0)
        forced = (imposed["tension"], rates["tendon"][frame]) if "tendon" in now else None
        loop.tick(machine.slot, imposed, forced, now.get("finger"))
        loop.tasks(slot, imposed)


def subsets(segments: Mapping[str, str]) -> list[frozenset[str]]:
    """All sets of segments."""
    return [frozenset(s) for size in range(len(segments) + 1) for s in combinations(segments, size)]


def segment_gaps(problem: Problem, values: np.ndarray, trial: Trial) -> tuple[dict[str, float], dict[str, float]]:
    """Exact Shapley shares of the closed-loop gap, and each segment's replay gap [floors], by segment.

    What is fed in is noisy, and a stiff wire turns a micrometre into newtons: the same replay of a log that the robot
    itself would have written, noise and rounding included, is subtracted. No shares where nothing is left, nor where a
    segment runs away with what it is fed.
    """
    frames = min(round(LONGEST / problem.robot.machine.frame), MOST)
    trial = trial.first(frames)
    power, alone = powers(problem, values, trial)
    floor, floor_alone = powers(problem, values, own_trial(problem, values, trial))
    net = {s: max(power[s] - floor[s], 0.0) for s in power}
    gaps = {s: float(np.sqrt(max(alone[s] ** 2 - floor_alone[s] ** 2, 0.0))) for s in alone}
    shares = shapley(net)
    if max(net.values()) > RUNAWAY * net[frozenset()]:
        return {}, {s: g for s, g in gaps.items() if g**2 * trial.measured.size < RUNAWAY * power[frozenset()]}
    return {s: shares[s] for s in problem.robot.machine.segments}, gaps


# a segment that makes the error this many times larger when fed with measurements integrates them, as a free mass does
RUNAWAY = 10.0


def own_trial(problem: Problem, values: np.ndarray, trial: Trial) -> Trial:
    """The trial as the robot itself would have logged it, with noise and rounding."""
    robot = replace(
        problem.robot, values=np.where(np.isin(np.arange(len(values)), noisy(problem)), problem.robot.values, values)
    )
    run = record(robot, Reference(trial.reference, trial.name), seed=0)
    flat = np.concatenate([run.signals[w.name] for w in problem.robot.machine.signals], axis=1)
    return replace(trial, measured=flat[:, problem.signal_indices])


def noisy(problem: Problem) -> list[int]:
    """Places of the numbers that prediction silences."""
    return [
        problem.robot.machine.index[name] for name in (*problem.robot.machine.noise, *problem.robot.machine.resolution)
    ]


def powers(problem: Problem, values: np.ndarray, trial: Trial) -> tuple[dict[frozenset[str], float], dict[str, float]]:
    """Residual power [floor^2] of the signals that are not overruled, for each set of fixed segments; and each
    segment's replay gap [floors].
    """
    segments = problem.robot.machine.segments
    power, alone = {}, {}
    for fixed in subsets(segments):
        difference = np.nan_to_num((trial.measured - replayed(problem, values, trial, fixed)) / problem.noise_std)
        free = [k not in {segments[s] for s in fixed} for k in problem.kinds]
        power[fixed] = float(np.sum(difference[:, free] ** 2))
        if len(fixed) == len(segments) - 1:
            (segment,) = set(segments) - fixed
            own = [k == segments[segment] for k in problem.kinds]
            alone[segment] = float(np.sqrt(np.mean(difference[:, own] ** 2)))
    return power, alone


def shapley(power: dict[frozenset[str], float]) -> dict[str, float]:
    """Shares, summing to 1, of the fall of `power` (set of fixed segments -> value) from none to all fixed."""
    everything = max(power, key=len)
    n, shares = len(everything), {}
    for segment in sorted(everything):
        shares[segment] = sum(
            factorial(len(s)) * factorial(n - len(s) - 1) / factorial(n) * (value - power[s | {segment}])
            for s, value in power.items()
            if segment not in s
        )
    total = sum(shares.values())
    return {name: value / total if total else 0.0 for name, value in shares.items()}
