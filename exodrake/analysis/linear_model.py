"""The sampled-data loop as one map over a frame, its state of rest by simulation, and its linear model and poles there.

    x_{n+1} = f(x_n, r_n, e_n)               w_n = g(x_n, r_n, e_n)
    x_{n+1} = A x_n + B r_n + N e_n          y_n = C x_n + D r_n + M e_n      (deviations from the operating point)

x holds the states of all parts at the frame's start, r the loop's references, e the sensors' standard normal noise, w
all signals at the frame's end. The map is the compiled simulator; Drake's `Linearize` refuses multi-rate diagrams.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from types import ModuleType
from typing import TYPE_CHECKING

import control
import numpy as np

from exodrake.core.errors import InputError, nearest, short_repr
from exodrake.engine.compose import compile_machine
from exodrake.engine.inputs import NOTHING, NoiseInputs, RunOptions, prepare_values
from exodrake.model.machine import Loop, full_name, signal_count, stack, state_size
from exodrake.model.part import NORMAL
from exodrake.model.robot import Robot

NUDGE = 0.02  # reference step that measures excursions, as a share of the loop's step
FRAMES = 8  # frames of it
UNMOVED = 1e-3  # excursion assumed of a state that does not move
FRACTIONS = (0.5, 0.25, 0.1, 0.05, 0.02)
FRACTION = 0.05  # where one will do
OUTSIDE = 1e-6  # width of the ring about the unit circle in which poles count as neither in nor out
ON_CIRCLE = 1e-9  # of |z|: what rounding leaves of an eigenvalue on the unit circle [-]
EXOGENOUS = ("drift", "disturbance")  # families of effects that come from outside
KINK = 0.02  # difference of one-sided slopes from which a note is given
UNLIKE = 0.5  # slopes of two step sizes that differ by more, as of a joint held by friction, are none: assumed
CHUNK, CHUNKS = 100, 30  # frames between two checks for rest; checks
REST = 1e-8  # change over a frame, in units of a state's excursion, below which the loop rests
SLOW = 1e-4  # the same after 60 s, below which a drift is too slow to matter
BESIDE = 1e-8  # distance at which a response is taken beside a pole on the circle: of a joint that friction holds
BATCH = 200  # frequencies solved at a time, for memory
FADED = 1e-100  # of an impulse response [SI], below which it is 0: products of such numbers are slow and negligible


def add_controller(robot: Robot) -> Robot:
    """The robot with the outer controller of a machine that has none of its own. InputError if it can have no loop."""
    loop = robot.machine.loop
    if loop is None:
        words = "its motion is measured, not commanded: no reference goes through a controller"
        raise InputError(f"{robot.machine.name}: no closed loop to analyse ({words})")
    return loop.outer(robot) if loop.outer else robot


@dataclass(frozen=True, eq=False)
class FrameMap:
    """The frame map of a robot, unquantised and free of noise, with the flat parameter vector (n,) [SI] in use."""

    robot: Robot
    loop: Loop  # closed loop that the machine declares: its signals and gains
    parameters: np.ndarray
    module: ModuleType
    outside: tuple[str, ...] = ()  # effects that act from outside, as noise does, and are left out: they move no pole

    @staticmethod
    def from_robot(robot: Robot) -> FrameMap:
        """The frame map of a robot. InputError if a parameter is missing, or the machine has no loop."""
        robot = add_controller(robot)
        assert robot.machine.loop is not None  # `add_controller` sees to it
        outside = tuple(i for i in robot.effects() if robot.machine.effect(i).family in EXOGENOUS)
        still = robot.without_effects(outside)
        values = prepare_values(still, quantisation=False)
        return FrameMap(still, robot.machine.loop, values, compile_machine(robot.machine), outside)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the loop's channels, in the order of its references."""
        return self.robot.machine.channels(self.loop.reference)

    @property
    def noises(self) -> tuple[str, ...]:
        """Names of the elements of e: sensor noise."""
        machine = self.robot.machine
        names = [n for n in machine.inputs if machine.signal[n].distribution == NORMAL]
        return tuple(f"{name}_{channel}" for name in names for channel in machine.channels(name))

    @cached_property
    def width(self) -> int:
        """Length of w."""
        return signal_count(self.robot.machine)

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Signal -> its name as an output: the kind of its log columns, else its own, with `_true` if taken."""
        machine = self.robot.machine
        shown = {c.signal: c.kind for c in machine.columns if c.signal not in machine.inputs}
        others = (s.name for s in machine.signals if s.name not in machine.inputs and s.name not in shown)
        return shown | {name: f"{name}_true" if name in shown.values() else name for name in others}

    @cached_property
    def outputs(self) -> dict[str, int]:
        """Name of an output, such as `tension_AF`, -> its index in w; those of the log first."""
        return {
            "_".join(filter(None, (kind, channel))): self.signals[signal].start + i
            for signal, kind in self.kinds.items()
            for i, channel in enumerate(self.robot.machine.channels(signal))
        }

    @cached_property
    def shown_rows(self) -> np.ndarray:
        """Indices in w (n,) [-] of the signals of the log and of the loop."""
        loop, w = self.loop, np.arange(self.width)
        wanted = {c.signal for c in self.robot.machine.columns} | {loop.command, loop.output, loop.measured}
        return np.concatenate([w[self.signals[s]] for s in self.kinds if s in wanted])

    @property
    def signals(self) -> dict[str, slice]:
        """Position of each signal in w."""
        return self.robot.machine.offsets

    def start(self) -> np.ndarray:
        """State (states,) [SI] at the start of a run."""
        x = np.zeros(state_size(self.robot.machine))
        self.module.begin(self.parameters, x)
        return x

    @cached_property
    def idle(self) -> dict[str, np.ndarray]:
        """Inputs of a frame by name, (1, channels) [SI], in the order of the machine: no noise, references of 0."""
        machine = self.robot.machine
        noise = NoiseInputs.draw(1, None, machine)
        return {n: noise[n] if n in noise else np.zeros((1, len(machine.channels(n)))) for n in machine.inputs}

    def run(
        self, state: np.ndarray, references: np.ndarray, seed: int | None = None, ticks: np.ndarray = NOTHING,
        noise: Mapping[str, np.ndarray] | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """State (states,) [SI] after some frames from a state, and all signals (frames, w) [SI] at the end of each.

        The loop's references are (frames, channels) [SI]. Without the seed of the sensors' noise, or its values by
        signal (frames, channels), there is none. `ticks` (slots, w) takes all signals at the end of each slot.
        """
        machine, frames = self.robot.machine, len(references)
        given = {self.loop.reference: references, **(noise or {})}
        given |= {} if seed is None else NoiseInputs.draw(frames, seed, machine)
        inputs = [
            np.ascontiguousarray(given[n], dtype=float) if n in given else row.repeat(frames, axis=0)
            for n, row in self.idle.items()
        ]
        x, w = state.copy(), np.zeros(self.width)
        rows, options = np.zeros((frames, self.width)), RunOptions(fine=ticks)
        self.module.run(self.parameters, x, w, *inputs, machine.slot, 1, rows, *options)
        return x, rows

    @cached_property
    def states(self) -> list[tuple[str, str, str]]:
        """Part, owner and state, and full name with channel, of each state: those of each part, then of its effects."""
        machine, found = self.robot.machine, []
        for block in machine.parts:
            for owner, states in ((block.name, block.states), *((e.id, e.states) for e in machine.effects_on(block))):
                for state in states:
                    for channel in machine.axes.of(state.axis):
                        for k in range(state.width):
                            parts = (owner, state.name, channel, str(k) if state.width > 1 else "")
                            found.append((block.name, f"{owner}.{state.name}", full_name(*parts)))
        return found

    @cached_property
    def own(self) -> np.ndarray:
        """Whether a state (states,) is the controller's own: the plant does not see it; the held command it does."""
        own, held = self.loop.part, f"{self.loop.part}.{self.loop.held}"
        return np.array([part == own and group != held for part, group, _ in self.states])

    def with_values(self, values: Mapping[str, float]) -> FrameMap:
        """The frame map with other parameters: name -> value [SI]; a name without its channel sets all channels."""
        changed, parameters = copy(self), self.parameters.copy()  # a copy keeps what is cached of the machine
        for name, value in values.items():
            parameters[self.robot.indices(name)] = value
        vars(changed)["parameters"] = parameters
        return changed


def resolve_references(loop: FrameMap, at: Mapping[str, float] | str | None) -> np.ndarray:
    """References (channels,) [SI] of an operating point, the machine's first without; InputError if there is none."""
    robot, channels, points = loop.robot, loop.channels, loop.loop.points
    at = next(iter(points)) if at is None else at
    lowest, highest = robot.reference_limits()
    if isinstance(at, str):
        if at not in points:
            raise InputError(f"no operating point {at!r}{nearest(at, list(points))}; there are {', '.join(points)}")
        at = {c: float(np.clip(points[at][c], *ends)) for c, *ends in zip(channels, lowest, highest)}
    if set(at) != set(channels):
        raise InputError(f"operating point names {', '.join(at)}; wanted {', '.join(channels)}")
    unit, lowest = robot.machine.signal[loop.loop.reference].unit, np.minimum(lowest, 0.0)
    for name, low, high in zip(channels, lowest if robot.machine.reference_limits else -highest, highest):
        if not math.isfinite(at[name]) or not low <= at[name] <= high:
            limits = f"{low:g} .. {high:g} {unit}"
            raise InputError(f"operating point {name} = {at[name]:g} {unit} is outside {limits}")
    return np.array([float(at[name]) for name in channels])


@dataclass(frozen=True)
class Pole:
    """A pole of the sampled loop: `z`, natural frequency [Hz], damping ratio, time constant [s], state most in it.

    The time constant is that of the decay by e; negative of a growth by e, infinite where |z| is 1 but for rounding.
    """

    z: complex
    frequency: float
    damping: float
    time_constant: float
    state: str

    @staticmethod
    def from_z(z: complex, period: float, state: str = "") -> Pole:
        """A pole with its continuous-time reading s = ln(z) / T."""
        if abs(z) < 1e-12:
            return Pole(z, np.inf, 1.0, 0.0, state)
        s = np.log(z) / period
        decay = np.inf if abs(abs(z) - 1.0) < ON_CIRCLE else -1.0 / s.real
        damping = -s.real / abs(s) if s != 0.0 else 0.0
        return Pole(z, float(abs(s)) / (2.0 * np.pi), float(damping), float(decay), state)


class System(control.StateSpace):
    """python-control's `StateSpace`, here with one step per frame, SI."""

    repr_format = "info"  # pyright: ignore  # name and signals in a line; print shows the matrices
    if TYPE_CHECKING:  # which python-control's own annotations leave open
        A: np.ndarray
        B: np.ndarray
        C: np.ndarray
        D: np.ndarray
        dt: float


@short_repr
@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """State of rest of a loop at a frame's start, under constant references."""

    references: np.ndarray  # (channels,) [SI]
    state: np.ndarray  # (states,) [SI]
    output: np.ndarray  # (channels,) the controlled quantity [SI]
    readings: dict[str, np.ndarray]  # column kind -> reading of each of its channels [SI]
    frames: int  # simulated until rest
    residual: float  # largest change over one frame, in units of each state's excursion
    steady: bool  # the robot's own gains brought it there, rather than gentler ones
    slack: tuple[str, ...]  # channels whose reference is above 0 and whose output is not, such as slack tendons


@short_repr
@dataclass(frozen=True, eq=False)
class FrameModel:
    """Linear model of a loop at an operating point with one step per frame, from the references to all signals, SI.

    Signals of the log have their columns' names; of two signals that share one, the one not in the log ends in `_true`.
    """

    loop: FrameMap = field(repr=False)
    point: OperatingPoint = field(repr=False)
    system: System
    N: np.ndarray  # (n, noises) and M (outputs, noises): answer to sensor noise of unit variance
    M: np.ndarray
    size: np.ndarray  # (states,) excursions of the states of the frame map [SI]
    keep: list[int]  # indices of its states among those of the frame map
    step: float  # fraction of the excursions used
    convergence: float  # change of A against the next fraction [excursions]
    kink: float  # largest difference of one-sided slopes [excursions]
    where: str  # state that shows it

    @property
    def spectral_radius(self) -> float:
        """Largest modulus of a pole; below 1 the loop is stable."""
        return spectral_radius(self.system.A)

    @property
    def marginal(self) -> bool:
        """Whether the spectral radius is 1 as far as differences can tell."""
        return abs(self.spectral_radius - 1.0) <= OUTSIDE

    @property
    def decides(self) -> bool:
        """Whether the poles tell if the loop is stable: not at a kink, such as stuck friction, nor on the circle."""
        return self.kink <= KINK and self.convergence <= UNLIKE and not self.marginal

    def poles(self) -> tuple[Pole, ...]:
        """Poles, the slowest to decay first."""
        values, right = np.linalg.eig(self.system.A)
        share = np.abs(np.linalg.pinv(right).T * right)
        order, names = np.argsort(-np.abs(values), kind="stable"), self.system.state_labels
        return tuple(Pole.from_z(complex(values[i]), self.system.dt, names[int(share[:, i].argmax())]) for i in order)

    def rows(self, signal: str) -> list[int]:
        """Indices of the outputs of a signal, one for each channel of the loop."""
        kind, labels = self.loop.kinds[signal], self.system.output_labels
        return [labels.index(f"{kind}_{channel}") for channel in self.loop.channels]


def evaluate(system: control.StateSpace, frequency: np.ndarray) -> np.ndarray:
    """Frequency response (f, outputs, inputs) [SI] at frequencies (f,) [Hz], solved many at a time."""
    z = np.exp(2j * np.pi * np.asarray(frequency, dtype=float) * system.dt)
    z[np.abs(z[:, None] - np.linalg.eigvals(system.A)).min(1, initial=1.0) < BESIDE] *= 1.0 + BESIDE
    eye, parts = np.eye(system.nstates), np.array_split(z, max(1, len(z) // BATCH))
    a, b, c, d = (np.asarray(matrix) for matrix in (system.A, system.B, system.C, system.D))
    return c @ np.concatenate([np.linalg.solve(p[:, None, None] * eye - a, b) for p in parts]) + d


def spectral_radius(a: np.ndarray) -> float:
    """Largest modulus of an eigenvalue of a matrix (n, n) [-]."""
    return float(np.abs(np.linalg.eigvals(a)).max(initial=0.0))


def compute_noise(a: np.ndarray, n: np.ndarray, c: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Standard deviation (outputs,) [SI] of y = C x + M e in the stationary state of a stable x' = A x + N e.

    a is (n, n), n (n, noises), c (outputs, n) and m (outputs, noises); e is white with unit variance.
    """
    covariance = n @ n.T  # P = A P A' + N N' by doubling; scipy's solver is ill-conditioned for states in SI
    while np.abs(a).max() > FADED:
        more = a @ covariance @ a.T
        covariance, a = covariance + more, a @ a
        a[np.abs(a) < FADED] = 0.0
        if np.abs(more).max() <= np.finfo(float).eps * np.abs(covariance).max():
            break
    return np.sqrt(np.diag(c @ covariance @ c.T + m @ m.T))


def measure_excursions(loop: FrameMap, state: np.ndarray, references: np.ndarray) -> np.ndarray:
    """Largest excursion of each state (states,) [SI] over small steps of all references."""
    size = np.zeros(len(state))
    for i in range(len(references)):
        rows = references.copy()
        rows[i] += NUDGE * loop.loop.step
        stepped, still = state, state
        for _ in range(FRAMES):
            stepped, _ = loop.run(stepped, rows[None, :])
            still, _ = loop.run(still, references[None, :])
            size = np.maximum(size, np.abs(stepped - still))
    groups = np.array([group for _, group, _ in loop.states])
    for group in set(groups):
        size[groups == group] = size[groups == group].max()
    size[size < 1e-12] = UNMOVED
    return size


def differentiate(
    loop: FrameMap, state: np.ndarray, references: np.ndarray, size: np.ndarray, fraction: float, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Central difference quotients of the frame map [SI]: rows x' then all signals w, columns x, r, e.

    Each state moves by a fraction of its excursion `size` (states,) [SI]; columns that are not in `columns` stay zero.
    The second result is (forward - backward) / 2 of the same shape: zero where the map is smooth.
    """
    n, after, noises = len(state), len(state) + len(references), len(loop.noises)
    normal = [name for name in loop.idle if loop.robot.machine.signal[name].distribution == NORMAL]
    places = stack({name: loop.idle[name].shape[1] for name in normal})
    point = np.concatenate([state, references, np.zeros(noises)])
    moves = fraction * np.concatenate([size, np.full(len(references), NUDGE * loop.loop.step), np.ones(noises)])

    def image(p: np.ndarray) -> np.ndarray:
        noise = {name: p[None, after:][:, place] for name, place in places.items()}
        x, signals = loop.run(p[:n], p[None, n:after], noise=noise)
        return np.append(x, signals[0])

    here = image(point)
    central, bend = np.zeros((len(here), len(point))), np.zeros((len(here), len(point)))
    for i in columns:
        up, down = point.copy(), point.copy()
        up[i] += moves[i]
        down[i] -= moves[i]
        above, below, width = image(up), image(down), up[i] - down[i]
        central[:, i], bend[:, i] = (above - below) / width, (above + below - 2.0 * here) / width
    return central, bend


def find_observed(a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Indices of the states on which outputs y = C x depend, at once or later; a (n, n) and c (outputs, n) [SI].

    Others, such as clocks and unread memories, are exact zeros, since a run is deterministic. With them, a shift
    register of m frames would make A defective, and its zero poles would appear at about (1e-16)^(1/m).
    """
    observed = np.any(c != 0.0, axis=0)
    for _ in a:
        observed = observed | np.any(a[observed] != 0.0, axis=0)
    return np.flatnonzero(observed)


def find_observed_states(loop: FrameMap, state: np.ndarray, references: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Indices of the states on which the log depends, at once or later; size: excursions (states,) [SI]."""
    n = len(state)
    central, _ = differentiate(loop, state, references, size, FRACTION, np.arange(n))
    return find_observed(central[:n, :n], central[n + loop.shown_rows, :n])


def linearise(loop: FrameMap, point: OperatingPoint) -> FrameModel:
    """The linear model at an operating point, from the references to all signals.

    Of the fractions of the excursions by which states are moved, that counts which agrees best with the one before it.
    """
    n, state, references = len(point.state), point.state, point.references
    size = measure_excursions(loop, state, references)
    columns = np.arange(n + len(references) + len(loop.noises))
    tried = [differentiate(loop, state, references, size, f, columns) for f in FRACTIONS]
    scaled = [central[:n, :n] * size / size[:, None] for central, _ in tried]
    gaps = [float(np.abs(a - b).max()) for a, b in pairwise(scaled)]
    best = int(np.argmin(gaps)) + 1  # of two fractions that agree, the smaller
    central, bend = tried[best]
    a, b, e = np.split(central[:n], [n, n + len(references)], axis=1)
    keep = find_observed(a, central[n + loop.shown_rows, :n])
    left_out = np.setdiff1d(np.arange(n), keep)
    rows = {name: n + i for name, i in loop.outputs.items() if not central[n + i, left_out].any()}
    c, d, m = np.split(central[list(rows.values())], [n, n + len(references)], axis=1)
    bends = np.abs(bend[np.ix_(keep, keep)] * size[keep] / size[keep, None]).max(axis=0, initial=0.0)
    names = [loop.states[i][2] for i in keep]
    system = System(
        a[np.ix_(keep, keep)], b[keep], c[:, keep], d, loop.robot.machine.frame,
        states=[name.replace(".", "_") for name in names], outputs=list(rows),
        inputs=[f"{loop.loop.reference}_{channel}" for channel in loop.channels],
    )  # fmt: skip
    kink, where = float(bends.max()), names[int(bends.argmax())]
    return FrameModel(
        loop, point, system, e[keep], m, size, keep.tolist(), FRACTIONS[best], gaps[best - 1], kink, where
    )


def measure_drift(
    loop: FrameMap, state: np.ndarray, references: np.ndarray, keep: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Largest change [excursions] over a frame from a state (states,) [SI], of the states on which the log depends.

    Their indices come with it; where those of an earlier state are given (n,) [-], they are found anew only at rest.
    """
    after, _ = loop.run(state, references[None, :])
    size = measure_excursions(loop, state, references)
    change = np.abs(after - state) / size
    if keep is None or not change[keep].max(initial=0.0) >= SLOW:
        keep = find_observed_states(loop, state, references, size)
    return float(change[keep].max(initial=0.0)), keep


def operating_point(loop: FrameMap, at: Mapping[str, float] | str | None = None) -> OperatingPoint:
    """The loop at rest under references `at` [SI per channel, or the name of a point of the machine].

    Where the robot's own gains do not bring it to rest, gentle ones do; that state counts if its own keep it at rest.
    InputError where neither does, for such a loop has no operating point: creep, a limit cycle.
    """
    references, machine, frames = resolve_references(loop, at), loop.robot.machine, 0
    state, residual, steady = loop.start(), np.inf, True
    for steady, tried in ((True, loop), (False, loop.with_values(loop.loop.gentle))):
        state, drift, last, seen = tried.start(), np.inf, frames + CHUNK * CHUNKS, None
        while not drift < REST and frames < last:
            state, _ = tried.run(state, np.tile(references, (CHUNK, 1)))
            (drift, seen), frames = measure_drift(tried, state, references, seen), frames + CHUNK
        residual = drift if steady else measure_drift(loop, state, references)[0]
        if residual < SLOW:
            break
    else:
        unit = machine.signal[loop.loop.reference].unit
        words = ", ".join(f"{name} = {r:g} {unit}" for name, r in zip(loop.channels, references))
        present = ", ".join(loop.robot.effects()) or "no effect in it"
        still = f"a state still moves {residual:.2g} of its excursion a frame ({present})"
        raise InputError(f"the loop does not come to rest at {words}: {still}")
    _, signals = loop.run(state, references[None, :])
    output = signals[0, loop.signals[loop.loop.output]]
    readings = {c.kind: signals[0, loop.signals[c.signal]] for c in machine.columns}
    slack = tuple(n for n, r, y in zip(loop.channels, references, output) if machine.reference_limits and r > 0.0 >= y)
    return OperatingPoint(references, state, output, readings, frames, residual, steady, slack)


def linearise_robot(robot: Robot, at: Mapping[str, float] | str | None = None) -> FrameModel:
    """The linear model of a robot where it rests. InputError as `operating_point`."""
    loop = FrameMap.from_robot(robot)
    return linearise(loop, operating_point(loop, at))
