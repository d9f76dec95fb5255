"""Protocols: tension references (frames, tendons) [N] of one row per frame.

    exo.simulate(robot, exo.grasp("caging"))        exo.sweeps()        exo.protocol("chirp:high=1.5", robot)

By name, as the command line asks for them, they suit any machine; `from_log` follows the references of a log.

Levels are shares of each tendon's `F_max`; no reference ever falls below its anti-slack limit `F_min` (both in the
robot's limits). All are reproducible: those with chance in them take a seed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from inspect import signature
from itertools import product
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError, argument, nearest
from exodrake.data.formats import read_log
from exodrake.data.log import ALIKE, Log
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import robot_or_default
from exodrake.model.machine import Machine
from exodrake.model.part import TENDONS
from exodrake.model.robot import Robot
from exodrake.model.units import quantity

SMOOTH = 0.08  # s, standard deviation of the filter of a motion whose rates are inputs, too: assumed


def smooth(share: np.ndarray) -> np.ndarray:
    """Minimum-jerk step (n,) [-] from 0 to 1 while `share` (n,) [-] goes from 0 to 1."""
    x = np.clip(share, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def clock(robot: Robot, **durations: float) -> np.ndarray:
    """Starts of the frames (frames,) [s] in the sum of these durations [s]; InputError naming a bad or too long one."""
    for name, value in durations.items():
        if not 0.0 <= value <= 86400.0:
            raise InputError(f"{name} is {value} s, wanted 0 to a day")
    frames = round(sum(durations.values()) / robot.machine.frame)
    if frames < 1:
        raise InputError(f"{' + '.join(durations)} is {sum(durations.values())} s, shorter than a frame")
    return robot.machine.frame * np.arange(frames)


def check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    """InputError naming a number outside low .. high, or not a number."""
    if not low <= value <= high:
        raise InputError(f"{name} is {value} {unit}, wanted {low:g} to {high:g}")


def whole(name: str, value: float, high: int, unit: str) -> int:
    """A number of things from 1 to `high`; InputError naming one that is outside, or no whole number."""
    check_range(name, value, 1, high, unit)
    if value != int(value):
        raise InputError(f"{name} is {value} {unit}, wanted a whole number")
    return int(value)


def above_minimum(robot: Robot, tension: np.ndarray, name: str) -> Reference:
    """The reference of these tensions (frames, tendons) [N], raised to the lower limit where they are below."""
    return Reference(np.maximum(tension, robot.reference_limits()[0]), name)


def generator(seed: int) -> np.random.Generator:
    """Seeded chance; InputError for a seed that is no whole number from 0."""
    if seed != int(seed) or seed < 0:
        raise InputError(f"seed is {seed}, wanted a whole number from 0")
    return np.random.default_rng(int(seed))


LEVELS = (0.0, 1 / 3, 2 / 3, 1.0)  # of F_max: the paper's 0, 33, 66, 100 %
ROUNDING = 1e-12  # relative, of a frequency times a period
MOST_CROSSED = 4  # channels: 256 sweeps, 21 min; assumed to be as long as anybody waits


def grasp(
    mode: str = "caging", robot: Robot | None = None, targets: Mapping[str, float] | None = None,
    *, rest: float = 0.5, approach: float = 1.0, hold: float = 2.5, release: float = 1.0,
) -> Reference:  # fmt: skip
    """One grasp: rest, minimum-jerk approach to the mode's target tensions, hold, minimum-jerk release, rest.

    Args: mode: one of `robot.grasps`, or any name if `targets` (tendon -> tension [N]) are given; rest (before and
    after), approach, hold, release: durations [s]. InputError naming the mode, tendon, value or duration.

    Examples:
        >>> grasp("narrow-pinch", hold=1.0).values.shape
        (200, 3)
    """
    robot = robot_or_default(robot)
    tendons, (lowest, highest) = robot.machine.axes.tendons, robot.reference_limits()
    if targets is None and mode not in robot.grasps:
        hint = nearest(mode, list(robot.grasps))
        raise InputError(f"unknown grasp mode {mode!r}{hint}; there are {', '.join(robot.grasps)}")
    wanted = robot.grasps[mode] if targets is None else targets
    for tendon in wanted:
        if tendon not in tendons:
            raise InputError(f"{mode}: unknown tendon {tendon!r}; the robot has {', '.join(tendons)}")
    for tendon, high in zip(tendons, highest):
        if tendon not in wanted:
            raise InputError(f"{mode}: no target tension for tendon {tendon}")
        if not 0.0 <= (value := wanted[tendon]) <= high:
            raise InputError(f"{mode}: target tension of {tendon} is {value} N, wanted 0 to F_max = {high:g} N")
    peak = np.maximum([wanted[tendon] for tendon in tendons], lowest)
    time = clock(robot, rest=rest, approach=approach, hold=hold, release=release, rest_after=rest)
    frame = robot.machine.frame
    up = smooth((time - rest) / max(approach, frame))
    down = smooth((time - rest - approach - hold) / max(release, frame))
    return above_minimum(robot, lowest + np.outer(up - down, peak - lowest), mode)


def one_by_one(highest: np.ndarray, base: float, course: np.ndarray) -> np.ndarray:
    """Each tendon in turn follows a course (frames,), the others stand at `base`, as shares of F_max (tendons,) [N]."""
    tension = np.tile(base * highest, (len(highest), len(course), 1))
    for tendon, top in enumerate(highest):
        tension[tendon, :, tendon] = course * top
    return tension.reshape(-1, len(highest))


def one_sweep(robot: Robot, tendon: int, levels: Sequence[float], period: float) -> np.ndarray:
    """One tendon 0-100-0 % of F_max in `period` [s], others at `levels` (tendons,) of F_max; (frames, tendons) [N]."""
    time, highest = clock(robot, period=period), robot.reference_limits()[1]
    tension = np.tile(np.asarray(levels) * highest, (len(time), 1))
    tension[:, tendon] = highest[tendon] * (1.0 - np.abs(2.0 * time / period - 1.0))
    return tension


def sweeps(robot: Robot | None = None, *, period: float = 5.0) -> Reference:
    """The paper's protocol in full: each tendon ramps 0-100-0 % against all pairs of levels of the others, 48 sweeps.

    period: of one sweep up and down [s]; 48 of them take 240 s.

    Examples:
        >>> len(sweeps().values) * 0.02
        240.0
    """
    robot = robot_or_default(robot)
    tendons = len(robot.reference_limits()[1])
    if tendons > MOST_CROSSED:
        count = tendons * len(LEVELS) ** (tendons - 1)
        raise InputError(f"sweeps: {tendons} channels would cross in {count} sweeps; try short-sweeps")
    crossed = [
        one_sweep(robot, tendon, [*levels[:tendon], 0.0, *levels[tendon:]], period)
        for tendon in range(tendons)
        for levels in product(LEVELS, repeat=tendons - 1)
    ]
    return above_minimum(robot, np.concatenate(crossed), "sweeps")


def short_sweeps(robot: Robot | None = None, *, period: float = 5.0) -> Reference:
    """Twelve of the sweeps in 60 s, as in the reference data: one other at 0, 33, 66, 100 %, the rest slack-free.

    The first tendon sweeps against the second, all later ones against the first. period: of one sweep [s].

    Examples:
        >>> import exodrake as exo
        >>> short_sweeps(exo.load_robot()).values.shape
        (3000, 3)
    """
    robot = robot_or_default(robot)
    tendons = len(robot.reference_limits()[1])
    chosen = [
        one_sweep(robot, tendon, [level if other == int(tendon == 0) else 0.0 for other in range(tendons)], period)
        for tendon, level in product(range(tendons), LEVELS)
    ]
    return above_minimum(robot, np.concatenate(chosen), "short-sweeps")


def maximum_tension(robot: Robot | None = None, *, ramp: float = 10.0, dwell: float = 2.0) -> Reference:
    """First step of the paper's Section 2.3: each tendon in turn ramps slowly to F_max and back, others slack-free.

    `identification.maximum_tension` reads from the log at which tension of each tendon the joints stop. The limits
    F_max of the robot file are then what is safe. ramp: duration up, and down [s]; dwell: before it, and at F_max [s].

    Examples:
        >>> import exodrake as exo
        >>> maximum_tension(exo.load_robot()).values.shape
        (3600, 3)
    """
    robot = robot_or_default(robot)
    time, frame = clock(robot, rest=dwell, up=ramp, dwell=dwell, down=ramp), robot.machine.frame
    course = np.clip(np.minimum(time - dwell, 2.0 * (ramp + dwell) - time) / max(ramp, frame), 0.0, 1.0)
    return above_minimum(robot, one_by_one(robot.reference_limits()[1], 0.0, course), "maximum-tension")


def chirp(
    robot: Robot | None = None, *, low: float = 0.1, high: float = 2.5, span: float = 12.0, base: float = 0.15,
    top: float = 0.8,
) -> Reference:  # fmt: skip
    """Each tendon in turn swings between 10 % and `top` of F_max, ever faster; the others stand at `base`.

    Args: low, high: frequencies [Hz], exponential in time; span: duration per tendon [s]; base, top: shares of F_max.

    Examples:
        >>> chirp(high=1.5).name
        'chirp'
    """
    robot = robot_or_default(robot)
    nyquist = 0.5 / robot.machine.frame
    check_range("low", low, 1e-3, nyquist, "Hz")
    check_range("high", high, low * (1.0 + 1e-6), nyquist, "Hz")
    check_range("base", base, 0.0, 1.0, "of F_max")
    check_range("top", top, 0.1, 1.0, "of F_max")
    time, highest = clock(robot, span=span), robot.reference_limits()[1]
    growth = np.log(high / low) / span
    phase = 2.0 * np.pi * low * np.expm1(growth * time) / growth
    bottom = 0.1
    swing = bottom + (top - bottom) * (1.0 - np.cos(phase)) / 2.0
    return above_minimum(robot, one_by_one(highest, base, swing), "chirp")


def holds(robot: Robot | None = None, *, seed: int = 0, count: int = 5, dwell: float = 8.0) -> Reference:
    """Steps of all tendons to random levels of 10 to 90 % of F_max, `count` of them, each held `dwell` [s].

    Examples:
        >>> holds(count=2, dwell=4.0).values.shape
        (400, 3)
    """
    robot = robot_or_default(robot)
    count = whole("count", count, 1000, "holds")
    highest = robot.reference_limits()[1]
    levels = generator(seed).uniform(0.1, 0.9, (count, len(highest))) * highest
    return above_minimum(robot, np.repeat(levels, len(clock(robot, dwell=dwell)), axis=0), "holds")


def steps(robot: Robot | None = None, *, base: float = 0.2, top: float = 0.5, dwell: float = 2.0) -> Reference:
    """Each tendon in turn steps from `base` to `top` (shares of F_max) and back, `dwell` [s] on each level.

    Examples:
        >>> float(steps(top=0.5).values.max())
        6.0
    """
    robot = robot_or_default(robot)
    check_range("base", base, 0.0, 1.0, "of F_max")
    check_range("top", top, 0.0, 1.0, "of F_max")
    highest, count = robot.reference_limits()[1], len(clock(robot, dwell=dwell))
    first = np.tile(base * highest, (count, 1))
    each = one_by_one(highest, base, np.repeat([top, base], count))
    return above_minimum(robot, np.concatenate([first, each]), "steps")


def multisine(
    robot: Robot | None = None, *, seed: int = 0, high: float = 5.0, period: float = 20.0, repeats: int = 2,
    base: float = 0.3,
) -> Reference:  # fmt: skip
    """All tendons at once, each on its own comb of harmonics, so that one run tells their frequency responses apart.

    Args: high: highest frequency [Hz]; period [s] of the lowest harmonic; repeats of it; base: mean [F_max], about
    which 0.2 F_max are swung.

    Examples:
        >>> multisine(period=10.0, repeats=3).values.shape
        (1500, 3)
    """
    robot = robot_or_default(robot)
    time, highest, rng = clock(robot, period=period), robot.reference_limits()[1], generator(seed)
    check_range("high", high, len(highest) / period, 0.5 / robot.machine.frame, "Hz")
    check_range("base", base, 0.0, 0.8, "of F_max")
    repeats, last = whole("repeats", repeats, 1000, "periods"), int(high * period * (1.0 + ROUNDING))
    tension, tendons, swing = np.empty((len(time), len(highest))), len(highest), 0.2
    for tendon in range(tendons):
        harmonics = np.arange(tendon + 1, last + 1, tendons)
        turns = 2.0 * np.pi * (np.outer(time, harmonics) / period + rng.random(len(harmonics)))
        course = np.cos(turns).sum(axis=1)
        tension[:, tendon] = highest[tendon] * (base + swing * course / np.abs(course).max())
    return above_minimum(robot, np.tile(tension, (repeats, 1)), "multisine")


def random_motion(
    robot: Robot | None = None, *, seed: int = 0, duration: float = 40.0, fastest: float = 0.8
) -> Reference:
    """Smooth random motion of all tendons at once between F_min and 90 % of F_max, resembling no other protocol.

    Args: duration [s]; fastest: highest frequency in it [Hz].

    Examples:
        >>> random_motion(seed=1, duration=10.0).values.shape
        (500, 3)
    """
    robot = robot_or_default(robot)
    check_range("fastest", fastest, 0.01, 5.0, "Hz")
    time, rng = clock(robot, duration=duration), generator(seed)
    lowest, highest = robot.reference_limits()
    tension, sines, share = np.empty((len(time), len(highest))), 7, 0.9
    for tendon in range(len(highest)):
        frequency = rng.uniform(0.03 * fastest, fastest, sines)
        weight = rng.standard_normal(sines) / (frequency + 0.3 * fastest)
        turns = 2.0 * np.pi * (np.outer(time, frequency) + rng.random(sines))
        course = np.sin(turns) @ weight / np.linalg.norm(weight)
        tension[:, tendon] = lowest[tendon] + (share * highest[tendon] - lowest[tendon]) / (1.0 + np.exp(-2.0 * course))
    return above_minimum(robot, tension, "random-motion")


NAMED = (sweeps, short_sweeps, maximum_tension, chirp, holds, steps, multisine, random_motion)
PROTOCOLS: dict[str, Callable[..., Reference]] = {one.__name__.replace("_", "-"): one for one in NAMED}
# SI unit of the options of protocols; those without one are shares and counts
UNITS = {
    **dict.fromkeys(("rest", "approach", "hold", "release", "period", "span", "dwell", "duration", "ramp"), "s"),
    **dict.fromkeys(("low", "high", "fastest"), "Hz"),
}


def split_options(text: str) -> tuple[str, dict[str, str]]:
    """`name:a=1,b=2 mm` as the name and its values; InputError naming what is none."""
    name, _, tail = text.partition(":")
    found = {}
    for item in filter(None, tail.split(",")):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals:
            raise InputError(f"{name}: {item!r} is not of the form name=number")
        if key in found:
            raise InputError(f"{name}: {key!r} comes twice")
        found[key] = value
    return name.strip(), found


def protocol(text: str, robot: Robot | None = None) -> Reference:
    """The protocol or grasp mode of that name, with options: `holds:seed=3,dwell=5 s`.

    InputError with the nearest names for an unknown name or option.

    Examples:
        >>> import exodrake as exo
        >>> exo.protocol("holds:dwell=1.5 s").values.shape  # frames, tendons
        (375, 3)
    """
    robot = robot_or_default(robot)
    name, given = split_options(text)
    if name not in PROTOCOLS and name not in robot.grasps:
        there = [*robot.grasps, *PROTOCOLS]
        raise InputError(f"unknown protocol or grasp mode {name!r}{nearest(name, there)}; there are {', '.join(there)}")
    function = PROTOCOLS.get(name, grasp)
    options = {n: p.default for n, p in signature(function).parameters.items() if p.kind is p.KEYWORD_ONLY}
    for key in given:
        if key not in options:
            raise InputError(f"{name} has no option {key!r}{nearest(key, list(options))}; it has {', '.join(options)}")
    values = {key: quantity(value, UNITS.get(key, "-"), f"{name}: {key}") for key, value in given.items()}
    return on_machine(function, robot, **values) if name in PROTOCOLS else grasp(name, robot, None, **values)


def on_machine(function: Callable[..., Reference], robot: Robot, **options: float) -> Reference:
    """A protocol on any machine: tensions are shares of the highest one, other references of the span of the limits."""
    machine, limits = robot.machine, robot.machine.reference_limits
    first, *others = machine.references
    if not limits or not all(robot.limits.get(name) for name in limits):
        raise InputError(
            f"{machine.name} has no limits of {first.kind} (`reference_limits` of machine.py, `limits` of robot.yaml), "
            "so no protocol fits it; --reference LOG follows a log"
        )
    if machine.signal[first.signal].axis == TENDONS and not others:
        return function(robot, **options)
    low, high = robot.reference_limits()
    channels = machine.channels(first.signal)
    unit = replace(robot, limits={name: dict.fromkeys(channels, level) for name, level in zip(limits, (0.0, 1.0))})
    shares = function(unit, **options)
    return Reference(complete_inputs(machine, low + shares.values * (high - low)), shares.name)


def complete_inputs(machine: Machine, stated: np.ndarray, held: np.ndarray | None = None) -> np.ndarray:
    """All inputs (n, inputs) [SI] of a motion that states the first ones, (n, channels) [SI].

    `kind_start` stands where `kind_ref` begins, rates are those of the smoothed motion, further inputs stand as in
    `held` (inputs,) [SI], or at 0.
    """
    first, *others = machine.references
    rows, at = {first.kind: stated}, stated.shape[1]
    if any(column.rate_of for column in others):  # a body with mass cannot follow corners
        from scipy.ndimage import gaussian_filter1d

        rows = {first.kind: gaussian_filter1d(stated, SMOOTH / machine.frame, axis=0, mode="nearest")}
    for column in others:
        begin, at = at, at + len(machine.channels(column.signal))
        if column.rate_of:
            rows[column.kind] = np.gradient(rows[column.rate_of], machine.frame, axis=0)
            continue
        start = column.kind == first.kind.removesuffix("_ref") + "_start"
        still = stated[0] if start else np.zeros(at - begin) if held is None else held[begin:at]
        rows[column.kind] = np.tile(still, (len(stated), 1))
    return np.hstack(list(rows.values()))


def reference_rows(machine: Machine, log: Log) -> np.ndarray:
    """References of a log (n, references) [SI], in the order of `machine.references`."""
    return np.column_stack([log.array(c.kind, machine.channels(c.signal)) for c in machine.references])


def from_log(path: str | Path | Log, robot: Robot | None = None) -> Reference:
    """The references of a log or its file, as they are.

    Raises:
        InputError: for an unknown channel, a missing sample, a tension below 0, fewer than two rows, and another
            clock than the machine's.

    Examples:
        >>> import exodrake as exo
        >>> exo.write_log(exo.simulate(exo.load_robot(), "caging"), "mine.csv")
        >>> from_log("mine.csv").values.shape
        (275, 3)
    """
    machine = robot_or_default(robot).machine
    log = path if isinstance(path, Log) else read_log(argument("path", path, str, Path, Log))
    for column in machine.references:
        signal, channels = machine.signal[column.signal], machine.channels(column.signal)
        for channel in log.names(column.kind):
            if channel not in channels:
                known = f"{machine.name} has {', '.join(channels)}"
                raise InputError(f"{log.label}: {column.kind} of an unknown channel {channel!r}; {known}")
        values = log.array(column.kind, channels)
        low, wanted = (0.0, "0 or more") if signal.axis == TENDONS and signal.unit == "N" else (-np.inf, "a number")
        for row, k in np.argwhere(~(np.isfinite(values) & (values >= low)))[:1]:
            what = "is missing" if np.isnan(values[row, k]) else f"is {values[row, k]:g} {signal.unit}"
            raise InputError(f"{log.label}: {column.kind}_{channels[k]} {what} in row {row + 2}, wanted {wanted}")
    if len(log) < 2 or np.abs(np.diff(log.time) - machine.frame).max() > ALIKE:
        raise InputError(f"{log.label}: not two rows or more, {machine.frame:g} s apart; see exodrake.regularise")
    return Reference(reference_rows(machine, log), Path(log.label).name.split(".")[0])
