"""Protocols: tension references (frames, tendons) [N] of one row per frame.

    exo.simulate(robot, exo.grasp("caging"))        exo.sweeps()        exo.protocol("chirp:high=1.5", robot)

Levels are shares of each tendon's `F_max`; no reference ever falls below its anti-slack limit `F_min` (both in the
robot's limits). All are reproducible: those with chance in them take a seed.
"""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import robot_or_default
from exodrake.model.robot import Robot


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
    chosen = []
    for tendon, level in product(range(tendons), LEVELS):
        levels = np.zeros(tendons)
        if tendons > 1:
            levels[1 if tendon == 0 else 0] = level
        chosen.append(one_sweep(robot, tendon, list(levels), period))
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
