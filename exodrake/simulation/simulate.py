"""Simulation of a robot on a reference, and its log, by the compiled simulator or by the Drake Diagram."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.errors import InputError, argument, nearest, short_repr
from exodrake.data.log import CHANGED, MODEL, Log
from exodrake.engine.inputs import NoiseInputs, Reference, prepare_values, reference_width
from exodrake.engine.run import run_compiled
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot
from exodrake.simulation.protocols import protocol

if TYPE_CHECKING:
    from pydrake.systems.framework import Context, Diagram


ENGINES = ["compiled", "drake"]


def delay(values: np.ndarray, late: np.ndarray) -> np.ndarray:
    """Rows `values` (n, k) [any unit] of so many rows ago, `late` (n, k) or (n, 1): Catmull-Rom; NaN at NaN."""
    last = len(values) - 1
    at = np.clip(np.arange(len(values))[:, None] - np.broadcast_to(late, values.shape), 0.0, float(last))
    i = np.minimum(np.nan_to_num(at).astype(int), max(last - 1, 0))
    p0, p1, p2, p3 = (np.take_along_axis(values, np.clip(i + k, 0, last), axis=0) for k in (-1, 0, 1, 2))
    f = at - i
    return p1 + 0.5 * f * (p2 - p0 + f * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + f * (3.0 * (p1 - p2) + p3 - p0)))


def delay_columns(machine: Machine, records: np.ndarray, indices: list[int]) -> np.ndarray:
    """Channels `indices` (runs, frames, indices) [SI] of noise-free runs (runs, frames, channels), with delays."""
    at, chosen = machine.offsets, records[:, :, indices]
    for signal, of in ((column.signal, column.delay) for column in machine.columns if column.delay):
        own = [k for k, i in enumerate(indices) if at[signal].start <= i < at[signal].stop]
        for row, late in enumerate(records[:, :, at[of.signal]] / machine.frame):
            if own and late.any():
                late = late if late.shape[1] == 1 else late[:, [indices[k] - at[signal].start for k in own]]
                chosen[row][:, own] = delay(chosen[row][:, own], late)
    return chosen


def delay_samples(machine: Machine, signals: dict[str, np.ndarray], noise_std: Callable[[str], float]) -> None:
    """Replaces delayed columns (frames, channels) [SI] by their values at t - delay, noise of `noise_std` aside."""
    for column in machine.columns:
        if (of := column.delay) and (late := signals[of.signal]).any():
            noise, own = np.array([*map(noise_std, of.noise_std)]) * signals[of.noise_input], signals[column.signal]
            signals[column.signal] = delay(own - noise, late / machine.frame) + noise


@short_repr
@dataclass(frozen=True, eq=False)
class Recording:
    """All signals of a run.

    Attributes:
        robot: robot that was simulated.
        reference: reference that it followed.
        time: (frames,) array, start of each frame [s].
        signals: name -> (frames, channels) array at the frame's end, in the unit of the signal.

    Examples:
        >>> import exodrake as exo
        >>> found = exo.record(exo.load_robot(), "caging")
        >>> print(found.time[-1].round(2), "s,", found.signals["stroke_read"].max().round(4), "m")
        5.48 s, 0.0124 m
    """

    robot: Robot
    reference: Reference
    time: np.ndarray
    signals: dict[str, np.ndarray]


def record(
    robot: Robot, reference: Reference | str, seed: int | None = 0, quantisation: bool = True, engine: str = "compiled",
    substeps: int = 1,
) -> Recording:  # fmt: skip
    """Runs a robot on a reference and returns all its signals.

    Args:
        robot: the robot.
        reference: what it follows; text names a protocol or grasp mode, as on the command line: "chirp:high=1.5".
        seed: of the noise; None runs without.
        quantisation: whether readings are rounded.
        engine: "compiled" or "drake": the same results to the last bit.
        substeps: plant ticks per slot.

    Returns:
        The signals at each frame's end.

    Raises:
        InputError: the reference has another width than the machine, a parameter divides by zero, or the run diverges.

    Examples:
        >>> import exodrake as exo
        >>> record(exo.load_robot(), "caging").signals["tension_read"].shape
        (275, 3)
    """
    robot, reference = argument("robot", robot, Robot), argument("reference", reference, Reference, str)
    recording = run(robot, reference, seed, quantisation, engine, substeps)
    machine, signals = robot.machine, recording.signals
    if not all(np.isfinite(rows).all() for rows in signals.values()):  # rounding makes a finite reading of a NaN
        columns = {
            f"{name}_{channel}".rstrip("_"): values
            for name, rows in signals.items()
            for channel, values in zip(machine.channels(name), rows.T, strict=True)
        }
        shown = {**write_log(recording).signals, **columns}
        name = next(name for name, values in shown.items() if not np.isfinite(values).all())
        moment = recording.time[int(np.argmin(np.isfinite(shown[name])))]
        raise InputError(f"the simulation diverges: {name} is not finite from {moment:g} s on; check the numbers set")
    return recording


def run(
    robot: Robot, reference: Reference | str, seed: int | None = 0, quantisation: bool = True, engine: str = "compiled",
    substeps: int = 1,
) -> Recording:  # fmt: skip
    """All signals of a robot that follows a reference, whether they are finite or not; arguments as in `record`."""
    reference = protocol(reference, robot) if isinstance(reference, str) else reference
    machine, frames = robot.machine, len(reference.values)
    if reference.values.shape[1] != (width := reference_width(machine)):
        raise InputError(f"{reference.name}: {reference.values.shape[1]} references, {machine.name} has {width}")
    noise_inputs = NoiseInputs.draw(frames, seed, machine)
    values = prepare_values(robot, quantisation)
    if engine not in ENGINES:
        raise InputError(f"unknown engine {engine!r}{nearest(engine, ENGINES)}; there are {', '.join(ENGINES)}")
    try:
        if engine == "drake":
            from exodrake.diagrams.diagram import run_diagram

            rows = run_diagram(robot, values, reference, noise_inputs, substeps)
        else:
            rows = run_compiled(machine, values, reference, noise_inputs, substeps)
    except ZeroDivisionError:
        raise InputError(f"{robot.source or machine.name}: a number is 0 that the equations divide by") from None
    signals = {name: rows[:, at] for name, at in machine.offsets.items()}
    delay_samples(machine, signals, lambda name: values[machine.index[name]])
    return Recording(robot, reference, machine.frame * np.arange(frames), signals)


def write_log(recording: Recording) -> Log:
    """The log that the robot would have written: the columns of its machine."""
    log = log_of_signals(recording.robot.machine, recording.time, recording.signals, recording.reference.name)
    return replace(log, simulated=CHANGED) if recording.robot.effects() else log


def log_of_signals(machine: Machine, time: np.ndarray, signals: Mapping[str, np.ndarray], source: str) -> Log:
    """The columns of a machine that there are signals (frames, channels) [SI] for, marked as simulated."""
    found, units = {}, {}
    for column in machine.columns:
        if column.signal in signals:
            names = machine.log_names([column])
            found |= dict(zip(names, signals[column.signal].T, strict=True))
            units |= dict.fromkeys(names, machine.signal[column.signal].unit)
    return Log(time, found, units, source=source, simulated=MODEL)


def simulate(
    robot: Robot, reference: Reference | str, seed: int | None = 0, quantisation: bool = True, engine: str = "compiled",
    substeps: int = 1,
) -> Log:  # fmt: skip
    """The log of a robot that follows a reference; arguments as in `record`.

    Examples:
        >>> import exodrake as exo
        >>> log = exo.simulate(exo.load_robot(), exo.grasp("caging"))
        >>> print(log["angle_PIP"].max().round(2), "rad")
        0.86 rad
    """
    return write_log(record(robot, reference, seed, quantisation, engine, substeps))


def diagram_log(diagram: Diagram, context: Context, signals: Mapping[str, np.ndarray] | None = None) -> Log:
    """The log that the robot of a Diagram would have written, one row for each frame that has ended.

    Time is that of the frame's start, and samples of a sensor on a clock of its own are late, as in `simulate`.
    References that are input ports of the Diagram are not in the log.

    Args:
        diagram: from `build_diagram`.
        context: root Context that has run.
        signals: those of the run where they are known, name -> (rows, channels) array [SI].

    Returns:
        The columns of the machine.

    Examples:
        >>> import exodrake as exo
        >>> diagram = exo.build_diagram(exo.load_robot(), exo.grasp("caging"))
        >>> len(diagram_log(diagram, diagram.CreateDefaultContext()))
        0
    """
    from exodrake.diagrams.diagram import check_diagram, find_parameter, logged_signals

    def value(name: str) -> float:
        try:
            return float(find_parameter(diagram, name).get(context)[0])
        except InputError:  # a system of one's own, which lacks the parameter, stands in the part's place
            return 0.0

    signals = dict(logged_signals(diagram, context) if signals is None else signals)
    robot_diagram = check_diagram(diagram)
    machine = robot_diagram.robot.machine
    delay_samples(machine, signals, value)
    time = machine.frame * (np.round(signals["time"] / machine.frame) - 1.0)
    return log_of_signals(machine, time, signals, robot_diagram.source)
