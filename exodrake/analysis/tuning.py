"""Tuning: the gains of each controller structure that settle fastest within requirements, and how fast a loop could be.

    minimise  max settling      subject to  overshoot, disk margin of all commands, noise of the commands

The maxima run over steps of every channel, the machine's operating points and robots drawn within the tolerances. The
search is on linear models, the answer is judged by nonlinear steps of other robots.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any

import control
import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import differential_evolution, linprog, minimize

from exodrake.analysis import linear_model as lm
from exodrake.analysis.closed_loop import list_remarks
from exodrake.analysis.margins import decibel, open_loop, open_responses, structured_bound
from exodrake.analysis.responses import BAND, BENT, StepResponse, linear_error, list_departures, returns, step_response
from exodrake.analysis.robustness import Band, band, points_band, within_tolerances
from exodrake.core.errors import InputError, argument, nearest, short_repr
from exodrake.core.parallel import one_blas_thread
from exodrake.core.progress import no_progress
from exodrake.model.machine import Controller
from exodrake.model.robot import Robot

FREQUENCIES, FRAMES = 120, 300  # of the disk margin; of a step
DESIGN_SEED, JUDGE_SEED = 1, 2  # of the robots that the search sees, and of others that judge its answer
SLACK = 0.04  # by which the search keeps away from each requirement, since steps are linear there
PENALTY = 20.0  # cost of a requirement missed by 100 %, in the length of the simulated steps: assumed
LEAST = 1e-12  # of a requirement that is 0, for a division
SEARCH: dict[str, Any] = {"maxiter": 14, "popsize": 8, "seed": 0, "polish": False, "init": "sobol", "tol": 1e-3}
UNSTABLE = 1e6  # cost of an unstable loop
ROUNDING = 1e-6  # of a step, by which the linear programme may miss its limits
LQG_RUNS = 60  # designs that are tried over all plants
# logarithms of the weights of command and integral, and of the disturbance, in units of the tuned loop's commands
LQG_BOUNDS = np.log([(1e-4, 1e4), (1e-9, 1.0), (1e-4, 10.0)])
MOVED = 1.5  # ratio of gain margins over operating points from which gains are scheduled
OWN, ASSUMED = "as it is", "assumed gains"  # the robot's controller, and an outer loop that no robot has as yet
NOISE_FACTOR = 2.0  # noise of the commands that is allowed by default, in units of what the robot has: assumed


@short_repr
@dataclass(frozen=True)
class Requirements:
    """Requirements on a closed loop; among controllers that hold them the fastest to settle is the best.

    Attributes:
        settling: longest settling time to 2 % of a step [s]; None: as short as possible.
        overshoot: largest overshoot as a fraction of a step.
        disk_margin: least disk margin of all commands at once.
        noise: largest standard deviation of a command [SI]; None: that of the robot as it is, times `NOISE_FACTOR`.

    Examples:
        >>> Requirements(overshoot=0.1).disk_margin
        0.6
    """

    settling: float | None = None
    overshoot: float = 0.05
    disk_margin: float = 0.6
    noise: float | None = None

    def __post_init__(self) -> None:
        """Raise InputError for a requirement that is negative or no number."""
        for name, value in vars(self).items():
            if value is not None and not value >= 0.0:
                raise InputError(f"{name.replace('_', ' ')} is {value:g}, wanted a number from 0")


@short_repr
@dataclass(frozen=True, eq=False)
class Tuned:
    """A tuned controller with its assessment: numbers are the worst of the bands, nan where one robot is unstable."""

    name: str
    robot: Robot
    gains: dict[str, float]  # that were searched [SI]
    steps: tuple[StepResponse, ...]  # nonlinear, of the robot itself at its own operating point
    bands: tuple[Band, ...]  # over operating points and tolerances
    settling: float  # [s]
    overshoot: float
    disk_margin: float
    noise: float  # [SI]
    missed: tuple[str, ...]  # requirements that it does not hold, a phrase each


def word_gains(gains: Mapping[str, float]) -> str:
    """Tuned gains [SI] by name as text; without any, why."""
    each = ", ".join(f"{name} = {value:.4g}" for name, value in gains.items())
    return each or "no tuned controller that holds all is faster"


@short_repr
@dataclass(frozen=True, eq=False)
class Limit:
    """How fast a loop could be, beside the best tuned controller, or the robot as it is without one.

    The bound holds for any controller on the linear plant at the machine's own point, without noise, that overshoots no
    more than required and whose commands and crosstalk are within those of the tuned controller.
    """

    settling: float  # bound, of the slowest channel [s]
    tuned: float  # by steps of the nominal robot with the tuned controller [s]; the slowest channel's, as above
    command_peak: float  # largest change of a command in their steps [command / reference]
    crosstalk: float  # largest change of another channel, as a fraction of the step
    lqg: Performance | None  # worst of the LQG design over all plants of the search; None if it destabilises one
    missed: tuple[str, ...]  # what LQG does not hold
    law: lm.System | None  # the LQG design; None without one


@dataclass(frozen=True, eq=False, repr=False)
class Tuning:
    """Controllers that were tuned, compared with the robot's own.

    Attributes:
        robot: robot whose controller is tuned.
        requirements: requirements that the controllers shall hold.
        compared: assessed controllers, the robot's own first.
        notes: conditions under which the linear model means little, a sentence each.
        limit: how fast any controller could be.
        schedule: operating point -> gains [SI] of the best structure tuned there alone, and the settling [s] predicted;
            empty where the gain margins of its fixed gains move by less than half over the points.

    Examples:
        >>> import exodrake as exo
        >>> tuning = exo.tune(exo.load_robot("emps"), exo.Requirements(overshoot=0.2), draws=0, judges=1)
        >>> tuning.best.name, tuning.best.settling < tuning.compared[0].settling
        ('cascade', True)
    """

    robot: Robot
    requirements: Requirements
    compared: tuple[Tuned, ...]
    notes: tuple[str, ...] = ()
    limit: Limit | None = None
    schedule: Mapping[str, tuple[dict[str, float], float]] = field(default_factory=dict)

    def __repr__(self) -> str:
        own, best = self.compared[0], self.best or self.compared[0]
        settles = f"settles in {best.settling:.3g} s ({own.name}: {own.settling:.3g} s)"
        words = f"best {best.name}, {settles}" if self.best else "none holds all requirements"
        head = f"Tuning({self.robot.machine.name}: {len(self.compared)} controllers; {words})"
        return f"{head}\n  {word_gains(best.gains)}"

    @property
    def best(self) -> Tuned | None:
        """The fastest controller that holds all requirements, the robot's own among them."""
        held = [t for t in self.compared if not t.missed]
        return min(held, key=lambda t: t.settling, default=None)

    @property
    def noise_unit(self) -> str:
        """Unit of the commands."""
        machine = self.robot.machine
        assert machine.loop is not None  # `tune` sees to it
        return machine.signal[machine.loop.command].unit

    def to_dict(self) -> dict[str, Any]:
        """All numbers, SI, with units in the keys where these are fixed."""
        keys = {"settling": "settling [s]", "overshoot": "overshoot", "disk_margin": "disk_margin"}
        keys |= {"noise": f"noise [{self.noise_unit}]"}

        def name_numbers(one: Requirements | Tuned) -> dict[str, Any]:
            return {key: getattr(one, name) for name, key in keys.items()}

        return {
            "required": name_numbers(self.requirements),
            "compared": {t.name: name_numbers(t) | {"gains": t.gains, "misses": t.missed} for t in self.compared},
            "best": self.best and self.best.name,
            "notes": self.notes,
            "limit": self.limit and {k: v for k, v in vars(self.limit).items() if k != "law"},
            "schedule": {p: {"gains": gains, "settling [s]": t} for p, (gains, t) in self.schedule.items()},
        }


def tune(
    robot: Robot, requirements: Requirements | None = None, only: tuple[str, ...] = (), draws: int = 4,
    judges: int = 12, progress: Callable[[str], None] | None = None,
) -> Tuning:  # fmt: skip
    """Tunes each controller structure of the machine's loop and compares them.

    Effects that leave no linear response at rest, such as dry friction or hysteresis, are left out of the plants and
    the assessment, and stay in the robots of the answer.

    Args:
        robot: whose loop it is.
        requirements: to be held; the defaults without.
        only: names of structures; all if empty.
        draws: robots within the tolerances that the search sees, beside the nominal one at every operating point.
        judges: other robots within the tolerances that judge the answer.
        progress: called with the name of each structure before its search.

    Raises:
        InputError: no closed loop, no state of rest with the robot's own controller, unknown structure.

    Examples:
        >>> import exodrake as exo
        >>> wanted = exo.Requirements(overshoot=0.2, disk_margin=0.7)
        >>> exo.tune(exo.load_robot("emps"), wanted, draws=0, judges=1).best.missed
        ()
    """
    argument("robot", robot, Robot)
    wanted = argument("requirements", requirements, Requirements, type(None)) or Requirements()
    say = progress or no_progress
    with one_blas_thread():
        whole = lm.FrameMap.from_robot(robot)
        loop, known = whole.loop, [c.name for c in whole.loop.controllers]
        if (name := next((name for name in only if name not in known), None)) is not None:
            there = f"there are {' | '.join(known)}"
            raise InputError(f"{robot.machine.name}: no controller {name!r}{nearest(name, known)}; {there}")
        rough = find_rough(whole.robot) if whole.robot.effects() and not is_linear(whole.robot) else []
        smooth = whole.robot.without_effects(rough)
        plants = [linearise_plant(smooth, at) for at in loop.points]
        plants += [linearise_plant(drawn) for _, drawn in within_tolerances(smooth, draws, DESIGN_SEED)]
        if wanted.noise is None:
            noises = [predict_performance(plant, linearise_law(plant, {})).noise for plant in plants]
            if np.isfinite(noises).any():
                wanted = replace(wanted, noise=NOISE_FACTOR * max(filter(np.isfinite, noises)))
        own = OWN if whole.loop is robot.machine.loop else ASSUMED
        compared, notes = [replace(assess(own, smooth, {}, wanted, judges), robot=whole.robot)], []
        for structure in (c for c in loop.controllers if not only or c.name in only):
            say(structure.name)
            fixed = {**structure.fixed, **compliance(plants[0], structure)}
            gains, named = search_gains(plants, structure, fixed, wanted), {}
            for name, value in {**fixed, **gains}.items():
                places = [smooth.machine.parameters[i].name for i in smooth.indices(name)]
                named |= dict(zip(places, np.broadcast_to(value, len(places)).tolist(), strict=True))
            changed = whole.robot.with_parameters(named, f"tuned by exodrake as {structure.name}")
            try:
                found = assess(structure.name, changed.without_effects(rough), gains, wanted, judges)
                compared.append(replace(found, robot=changed))
            except InputError as error:  # the nominal robot comes to rest nowhere with them
                notes.append(f"{structure.name!r} is left out, with {word_gains(gains)}: {error}")
        tuning = Tuning(whole.robot, wanted, tuple(compared))
        best = tuning.best or compared[0]
        notes += [describe_rough(rough, best)] if rough else []
        for one in (best, *(one for one in compared[1:] if not one.settling < np.inf)):
            model = lm.linearise_robot(one.robot.without_effects(rough))
            notes += list_departures(model, one.steps, f" of {one.name!r}")
        say("LQG and bound")
        limit = find_limit(plants, best, wanted)
        tuning = replace(tuning, notes=(*notes, *list_remarks(plants[0].model)), limit=limit)
        return replace(tuning, schedule=schedule_gains(plants[: len(loop.points)], tuning))


def find_rough(robot: Robot) -> list[str]:
    """Effects of a robot each of which alone leaves it no linear response about its rest; all, if only several do."""
    own = robot.effects()
    alone = [robot.without_effects([other for other in own if other != one]) for one in own]
    return [one for one, left in zip(own, alone, strict=True) if not is_linear(left)] or list(own)


def is_linear(robot: Robot) -> bool:
    """Whether poles decide on stability where a robot rests, and its steps follow the linear model."""
    model = lm.linearise_robot(robot)
    steps = (step_response(model.loop, model.point, j) for j in range(len(model.loop.channels)))
    return model.decides and all(linear_error(model, step) < BENT for step in steps)


def describe_rough(rough: list[str], tuned: Tuned) -> str:
    """How a tuned loop moves with effects that its tuning left out, by simulation, in a sentence."""
    loop = lm.FrameMap.from_robot(tuned.robot)
    point, unit = lm.operating_point(loop), loop.robot.machine.signal[loop.loop.output].unit
    steps = [step_response(loop, point, j) for j in range(len(loop.channels))]
    worst, them = max(steps, key=lambda s: abs(s.steady_error)), "all" if len(rough) > 1 else "it"
    off = f"leaves {worst.channel} of {tuned.name!r} {worst.steady_error:+.2g} {unit} off"
    return (
        f"tuned without {', '.join(rough)}, beside which no response at rest is linear; with {them} a step of "
        f"{worst.size:g} {unit} {off}, and a kick {'dies' if returns(loop, point) else 'does not die'} out"
    )


def find_limit(plants: list[Plant], tuned: Tuned, wanted: Requirements) -> Limit:
    """How fast any controller could be with the commands and crosstalk of a tuned one, and how fast LQG is."""
    plant, loop, frame = plants[0], plants[0].model.loop, plants[0].system.dt
    size, m = loop.loop.step, len(loop.channels)
    settling, peak, crosstalk = (
        max(v) for v in zip(*((s.settling, s.command_peak / size, s.crosstalk) for s in tuned.steps))
    )
    frames = int(np.clip(1.2 * settling / frame, 2, FRAMES)) if np.isfinite(settling) else FRAMES
    limits = [bound_settling(plant.system, j, peak, wanted.overshoot, crosstalk, frames) for j in range(m)]

    def design(logs: np.ndarray) -> lm.System | None:
        effort, integral, disturbance = np.exp(logs)
        try:
            return design_lqg(plant.system, (plant.N, plant.M), effort / peak**2, integral, disturbance * peak)
        except (np.linalg.LinAlgError, ValueError):
            return None

    def cost(logs: np.ndarray, over: list[Plant]) -> float:
        law = design(logs)
        return worst_cost(over, lambda _: law, wanted) if law else 1e3 * UNSTABLE

    nominal = [p for p in plants if p.model.loop.robot is loop.robot]
    first = differential_evolution(cost, LQG_BOUNDS, (nominal,), **SEARCH)
    found = minimize(cost, first.x, (plants,), method="Nelder-Mead", options={"maxfev": LQG_RUNS, "xatol": 0.05})
    bound = float(np.min([max(limits), settling]))  # the bound counts whole frames, a step is read in slots
    limit = partial(Limit, bound, settling, peak, crosstalk)
    if (law := design(found.x)) is None:
        return limit(None, ("no LQG design",), None)
    radii, settlings, overshoots, disks, noises = zip(*(astuple(predict_performance(one, law)) for one in plants))
    lqg = Performance(max(radii), max(settlings), max(overshoots), min(disks), max(noises))
    missed = list_missed(wanted, lqg, loop.robot.machine.signal[loop.loop.command].unit)
    return limit(lqg if lqg.radius < 1.0 else None, missed, law)


def schedule_gains(plants: list[Plant], tuning: Tuning) -> dict[str, tuple[dict[str, float], float]]:
    """Gains of the best structure at each operating point alone, where its margins move by half over the points."""
    best, loop, channels = tuning.best, plants[0].model.loop.loop, plants[0].model.loop.channels
    if best is None or best is tuning.compared[0]:
        return {}
    margins = [[m.numbers[f"gain margin {c} [dB]"] for m in best.bands[0].members] for c in channels]
    if len(plants) < 2 or np.ptp(margins, axis=1).max() < decibel(MOVED):
        return {}
    structure = next(c for c in loop.controllers if c.name == best.name)
    fixed, found = {**structure.fixed, **compliance(plants[0], structure)}, {}
    for name, plant in zip(loop.points, plants, strict=True):
        gains = search_gains([plant], structure, fixed, tuning.requirements, best.gains)
        found[name] = gains, predict_performance(plant, linearise_law(plant, {**fixed, **gains})).settling
    return found


def assess(name: str, robot: Robot, gains: dict[str, float], wanted: Requirements, draws: int) -> Tuned:
    """Assessment of a loop by nonlinear steps and linear margins, over operating points and tolerances."""
    loop = lm.FrameMap.from_robot(robot)
    point = lm.operating_point(loop)
    steps = tuple(step_response(loop, point, j) for j in range(len(loop.channels)))
    bands = (points_band(robot), band("tolerances", within_tolerances(robot, draws, JUDGE_SEED)))
    members = list(chain.from_iterable(b.members for b in bands))
    kind, unit = loop.kinds[loop.loop.command], robot.machine.signal[loop.loop.command].unit

    def collect(name: str) -> list[float]:
        return [m.numbers.get(name.format(c), np.nan) for m in members for c in loop.channels]

    settling, overshoot = float(np.max(collect("settling {} [s]"))), float(np.max(collect("overshoot {}")))
    noise = float(np.max(collect(f"noise of {kind} {{}} [{unit}]")))
    found = Performance(np.nan, settling, overshoot, float(np.min(collect("disk margin"))), noise)
    missed = list_missed(wanted, found, unit)
    if not np.isfinite(settling) and (undecided := sum(b.undecided for b in bands)):
        missed = (f"poles mean little in {undecided} robots",)
    if failures := sum(len(b.failures) for b in bands):
        missed = (*missed, f"{failures} robots without rest")
    return Tuned(name, robot, gains, steps, bands, *astuple(found)[1:], missed=missed)


def list_missed(wanted: Requirements, found: Performance, unit: str) -> tuple[str, ...]:
    """The requirements that are not held, a phrase each; nan holds nothing."""
    if not np.isfinite(found.settling):
        return ("does not settle",)
    held = {
        f"settles in {found.settling:.3g} s": wanted.settling is None or found.settling <= wanted.settling,
        f"overshoots {100.0 * found.overshoot:.2g} %": found.overshoot <= wanted.overshoot,
        f"disk margin {found.disk_margin:.2g}": found.disk_margin >= wanted.disk_margin,
        f"command noise {found.noise:.2g} {unit}": wanted.noise is None or found.noise <= wanted.noise,
    }
    return tuple(phrase for phrase, holds in held.items() if not holds)


@dataclass(frozen=True, eq=False)
class Plant:
    """A robot's plant from commands to readings at an operating point, linear, without the controller's states."""

    model: lm.FrameModel  # of the closed loop with the robot's own controller
    system: lm.System
    N: np.ndarray  # (n, noises) and M (channels, noises): the plant's answer to sensor noise of unit variance
    M: np.ndarray
    frequency: np.ndarray  # (f,) [Hz]
    response: np.ndarray  # (f, channels, channels) of the readings to the commands
    index: np.ndarray  # (channels,) a state that moves each reading
    size: np.ndarray  # (channels,) by how far it is moved
    held: bool  # the controller acts before the sensor reads: it sees the reading of the frame before


def linearise_plant(robot: Robot, at: Mapping[str, float] | str | None = None) -> Plant:
    """The linear plant of a robot at an operating point. InputError without loop or state of rest."""
    model = lm.linearise_robot(robot, at)
    loop, whole, size = model.loop, open_loop(model), model.size
    own, m, frequency = loop.own[model.keep], whole.ninputs, np.geomspace(4e-4, 1.0, FREQUENCIES) * 0.5 / whole.dt
    system = lm.System(whole.A[np.ix_(~own, ~own)], whole.B[~own], whole.C[m:, ~own], 0.0, whole.dt)
    drive = (model.N - whole.B @ model.M[model.rows(loop.loop.command)])[~own]
    noise, response = model.M[model.rows(loop.loop.measured)], open_responses(whole, frequency)[1]
    index = np.where(own, 0.0, np.abs(whole.C[m:]) * size[model.keep]).argmax(axis=1)
    seen = np.flatnonzero(~own & (np.vstack([whole.A[own], whole.C[:m]]) != 0.0).any(axis=0))
    if held := len(seen) == m and np.allclose(whole.C[m:, seen], 0.0, atol=1e-9):
        index, noise = seen, np.zeros_like(noise)
        system = lm.System(system.A, system.B, np.eye(len(own))[seen][:, ~own], 0.0, whole.dt)
        response = lm.evaluate(system, frequency)
    chosen = np.array(model.keep)[index]
    return Plant(model, system, drive, noise, frequency, response, chosen, 0.05 * size[chosen], held)


def linearise_law(plant: Plant, values: Mapping[str, Any]) -> lm.System:
    """The linear law of the plant's own controller with other parameters [SI], one or one for each channel.

        q' = F q + G [y; r]             v = K q + L [y; r]      readings y, references r, commands v

    The matrices are differences of the compiled frame map with q, r and y moved, so any law of a machine can be tuned.
    """
    loop, point = plant.model.loop.with_values(values), plant.model.point
    own, m = np.flatnonzero(loop.own), len(loop.channels)
    command, reading = loop.signals[loop.loop.command], loop.signals[loop.loop.measured]

    def image(x: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        after, signals = loop.run(x, r[None])
        return np.append(after[own], signals[0, command]), x[plant.index] if plant.held else signals[0, reading]

    n, q, nudge = len(point.state), len(own), 1e-3 * loop.loop.step
    moves = np.zeros((q + 2 * m, n + m))  # of the controller's states, the references and the readings, one at a time
    moves[np.arange(q + m), [*own, *range(n, n + m)]] = nudge
    moves[np.arange(q + m, q + 2 * m), plant.index] = plant.size
    rest, y = image(point.state, point.references)
    sent, measured = zip(*(image(point.state + move[:n], point.references + move[n:]) for move in moves))
    inner, outer, read = np.split(np.transpose(sent) - rest[:, None], [q, q + m], axis=1)
    inner = inner / nudge
    driven = np.hstack([read @ np.linalg.inv(np.transpose(measured[q + m :]) - y[:, None]), outer / nudge])
    keep = lm.find_observed(inner[:q], inner[q:])
    matrices = inner[np.ix_(keep, keep)], driven[keep], inner[q:][:, keep], driven[q:]
    return lm.System(*matrices, plant.system.dt)


@dataclass(frozen=True)
class Performance:
    """Performance of a controller on one linear plant; the worst over channels."""

    radius: float  # spectral
    settling: float  # to 2 % [s], beyond the horizon by what is missing
    overshoot: float  # as a fraction of a step
    disk_margin: float  # of all commands at once, never overstated
    noise: float  # largest standard deviation of a command [SI]


def predict_performance(plant: Plant, law: lm.System) -> Performance:
    """Performance of a law from readings and references to commands, as of `linearise_law`."""
    p, m = plant.system, plant.system.ninputs
    (g, h), (read, direct) = np.hsplit(law.B, [m]), np.hsplit(law.D, [m])
    a = np.block([[p.A + p.B @ read @ p.C, p.B @ law.C], [g @ p.C, law.A]])  # the plant's states first
    radius = lm.spectral_radius(a)
    if radius >= 1.0:
        return Performance(radius, np.inf, np.inf, 0.0, np.inf)
    b, x = np.vstack([p.B @ direct, h]), np.zeros((FRAMES + 1, len(a), m))
    for k in range(FRAMES):  # a step of each reference
        x[k + 1] = a @ x[k] + b
    share = np.einsum("cn,fnc->fc", p.C, x[1:, : p.nstates])
    outside = np.abs(share - 1.0) > BAND
    last = np.where(outside.any(axis=0), FRAMES - 1 - outside[::-1].argmax(axis=0), -1)
    missing = np.maximum(np.abs(share[-1] - 1.0) - BAND, 0.0)
    settling = float((p.dt * (last + 2 + FRAMES * missing)).max())
    kept = lm.find_observed(law.A.T, g.T)  # states that the readings move: those of a feed-forward are outside the loop
    feedback = lm.System(law.A[np.ix_(kept, kept)], g[kept], law.C[:, kept], read, p.dt)
    ratio = -lm.evaluate(feedback, plant.frequency) @ plant.response
    balanced = np.linalg.inv(np.eye(m) + ratio) - 0.5 * np.eye(m)
    drive = np.vstack([plant.N + p.B @ read @ plant.M, g @ plant.M])
    noise = lm.compute_noise(a, drive, np.hstack([read @ p.C, law.C]), read @ plant.M)
    disk_margin = float(1.0 / structured_bound(balanced)[0].max())
    return Performance(radius, settling, max(0.0, float(share.max()) - 1.0), disk_margin, float(noise.max()))


def compliance(plant: Plant, structure: Controller) -> dict[str, np.ndarray]:
    """Static compliance d(actuated)/d(reading) by parameter, (channels,) each [actuated / reading], or none."""
    if not structure.compliance:
        return {}
    model, signals = plant.model, plant.model.loop.loop
    gain = lm.evaluate(model.system, np.zeros(1))[0].real
    moved, read = gain[model.rows(signals.actuated)], gain[model.rows(signals.measured)]
    return dict(zip(structure.compliance, (moved @ np.linalg.inv(read)).T, strict=True))


def worst_cost(plants: list[Plant], law: Callable[[Plant], lm.System], wanted: Requirements) -> float:
    """Largest cost of a law over plants; the first that is unstable ends the search."""
    worst = 0.0
    for plant in plants:
        worst = max(worst, compute_cost(predict_performance(plant, law(plant)), wanted, plant.system.dt))
        if worst > UNSTABLE:
            break
    return worst


def compute_cost(p: Performance, wanted: Requirements, frame: float) -> float:
    """Settling time in frames, plus what each missed requirement costs; far above for an unstable loop."""
    if p.radius >= 1.0:
        return UNSTABLE * (1.0 + p.radius)
    most = wanted.noise if wanted.noise is not None else np.inf
    missed = (
        max(0.0, p.overshoot - wanted.overshoot * (1.0 - SLACK)) / max(wanted.overshoot, 0.01),
        max(0.0, 1.0 - p.disk_margin / max(wanted.disk_margin * (1.0 + SLACK), LEAST)),
        max(0.0, p.noise / max(most * (1.0 - SLACK), LEAST) - 1.0),
    )
    return p.settling / frame + FRAMES * PENALTY * sum(missed)


def search_gains(
    plants: list[Plant], structure: Controller, fixed: Mapping[str, float | np.ndarray], wanted: Requirements,
    start: Mapping[str, float] | None = None,
) -> dict[str, float]:  # fmt: skip
    """Gains [SI] of least cost over plants, with other parameters fixed, one value or (channels,) each.

    Without gains to start from, a global search over the nominal plants comes before the local one over all.
    """
    names = [g.parameter for g in structure.gains]
    bounds = [(np.log(g.low), np.log(g.high)) for g in structure.gains]

    def values(logs: np.ndarray) -> dict[str, float]:
        return {n: float(np.exp(x)) for n, x in zip(names, logs)}

    def cost(logs: np.ndarray, over: list[Plant]) -> float:
        inside = np.clip(logs, *np.array(bounds).T)
        worst = worst_cost(over, lambda plant: linearise_law(plant, {**fixed, **values(inside)}), wanted)
        return worst + 1e3 * float(np.abs(logs - inside).sum())

    if start:
        x = np.log([start[name] for name in names])
    else:
        nominal = [p for p in plants if p.model.loop.robot is plants[0].model.loop.robot]
        x = differential_evolution(cost, bounds, (nominal,), **SEARCH).x
    simplex = np.vstack([x, x - 0.15 * np.eye(len(names))])  # lowers each gain in turn by 15 %
    options = {"maxfev": 40 * len(names), "xatol": 1e-2, "fatol": 0.1, "initial_simplex": simplex}
    found = minimize(cost, x, (plants,), method="Nelder-Mead", options=options)
    return values(np.clip(found.x, *np.array(bounds).T))


def bound_settling(
    plant: lm.System, channel: int, peak: float, overshoot: float, crosstalk: float, frames: int
) -> float:
    """Least time [s] in which a channel can settle to 2 % of a unit step; nan if not within `frames`.

    A linear programme over commands with the least n: no controller, linear or not, settles sooner on that plant.

        |v(k)| <= peak      y(k) <= 1 + overshoot      |y(k) - 1| <= 2 %  for k >= n

    `peak` is in command / step; overshoot and crosstalk are fractions of the step.
    """
    m, pulse, x = plant.ninputs, np.zeros((frames, plant.ninputs, plant.ninputs)), np.array(plant.B)
    for k in range(frames):
        pulse[k], x = plant.C @ x, plant.A @ x
    after, before = np.tril_indices(frames)
    answer = np.zeros((m, frames, frames, m))  # readings at the end of a frame from the commands of another, of peak 1
    answer[:, after, before] = peak * pulse[after - before].transpose(1, 0, 2)
    answer = answer.reshape(m, frames, frames * m)
    others = np.delete(answer, channel, axis=0).reshape(-1, frames * m)

    def feasible(n: int) -> bool:
        above = 1.0 + np.where(np.arange(frames) >= n, min(BAND, overshoot), overshoot)
        rows = np.vstack([answer[channel], -answer[channel, n:], others, -others])
        limits = np.concatenate([above, np.full(frames - n, BAND - 1.0), np.full(2 * len(others), crosstalk)])
        rows = np.column_stack([rows, -np.ones(len(rows))])  # all limits may be missed by as much, the least possible
        bounds = [(-1.0, 1.0)] * (frames * m) + [(0.0, None)]
        for method in ("highs-ds", "highs-ipm"):  # either gives up now and then
            found = linprog(np.eye(frames * m + 1)[-1], rows, limits, bounds=bounds, method=method)
            if found.status == 0:
                return found.fun < ROUNDING
        return False

    first = bisect_left(range(frames), True, key=feasible)
    return plant.dt * (first + 1) if first < frames else float("nan")


def design_lqg(
    plant: lm.System, noise: tuple[np.ndarray, np.ndarray], effort: float, integral: float, disturbance: float
) -> lm.System:
    """LQG controller with integral action, from readings and references to commands.

    It minimises the mean of |y - r|^2 + integral |E|^2 + effort |v|^2; states are estimated by a Kalman filter for
    sensor noise of unit variance, N (n, noises) and M (channels, noises), and for white noise of a standard deviation
    `disturbance` [command] on the commands. The reference enters by the state and the command that hold it. E sums the
    readings' distance from the undisturbed answer, so that a step of the reference leaves it at 0. LinAlgError where
    the Riccati equations have no solution.
    """
    a, b, c, n, m = plant.A, plant.B, plant.C, plant.nstates, plant.ninputs
    weights = block_diag(c.T @ c, integral * np.eye(m))
    gain = control.dlqr(a, b, weights, effort * np.eye(m), integral_action=c)[0]
    process = noise[0] @ noise[0].T + disturbance**2 * b @ b.T
    kalman = control.dlqe(a, np.eye(n), c, 0.5 * (process + process.T), noise[1] @ noise[1].T)[0]
    hold = np.linalg.lstsq(np.block([[a - np.eye(n), b], [c, np.zeros((m, m))]]),
                           np.vstack([np.zeros((n, m)), np.eye(m)]), rcond=None)[0]  # fmt: skip
    state, total = gain[:, :n], gain[:, n:]
    feed, ideal = state @ hold[:n] + hold[n:], a - b @ state
    dynamics = np.block([[ideal - kalman @ c, -b @ total, np.zeros((n, n))], [np.zeros((m, n)), np.eye(m), -c],
                         [np.zeros((n, n + m)), ideal]])  # fmt: skip
    inputs = np.block([[kalman, b @ feed], [np.eye(m), np.zeros((m, m))], [np.zeros((n, m)), b @ feed]])
    rows = np.hstack([-gain, np.zeros((m, n))])
    return lm.System(dynamics, inputs, rows, np.hstack([np.zeros((m, m)), feed]), plant.dt)
