"""The frame map at an operating point: the loop at rest by simulation, its linear model with one step per frame, poles.

    x_{n+1} = A x_n + B r_n + N e_n        y_n = C x_n + D r_n + M e_n      (deviations from the operating point)

The derivatives are central differences. Each state moves by a fraction of its own excursion under a small reference
step. The fraction is chosen where two successive ones agree best. States on which no output depends, however late, are
left out: clocks, unread memories, the bus's old commands. Such states give exact zeros, since a run is deterministic.
With them, a shift register of m frames would make A defective, and its zero poles would appear at about (1e-16)^(1/m).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import control
import numpy as np

from exodrake.analysis.frame_map import FrameMap, name_states, resolve_references
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot

NUDGE = 0.02  # reference step that measures excursions, as a share of the loop's step
FRAMES = 8  # frames of it
UNMOVED = 1e-3  # excursion assumed of a state that does not move
FRACTIONS = (0.5, 0.25, 0.1, 0.05, 0.02)
FRACTION = 0.05  # where one will do
OUTSIDE = 1e-6  # width of the ring about the unit circle in which poles count as neither in nor out
ON_CIRCLE = 1e-9  # of |z|: what rounding leaves of an eigenvalue on the unit circle [-]
KINK = 0.02  # difference of one-sided slopes from which a note is given
CHUNK, CHUNKS = 100, 30  # frames between two checks for rest; checks
REST = 1e-8  # change over a frame, in units of a state's excursion, below which the loop rests
SLOW = 1e-4  # the same after 60 s, below which a drift is too slow to matter
BATCH = 200  # frequencies solved at a time, for memory


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
    """python-control's `StateSpace`, here with one step per frame, SI; no state is left out as useless."""

    if TYPE_CHECKING:  # which python-control's own annotations leave open
        A: np.ndarray
        B: np.ndarray
        C: np.ndarray
        D: np.ndarray
        dt: float

    def __init__(self, a: Any, b: Any, c: Any, d: Any, period: float, **names: Any) -> None:
        """From matrices, frame period [s], and lists of names `states`, `inputs`, `outputs`."""
        super().__init__(a, b, c, d, period, remove_useless_states=False, **names)


@dataclass(frozen=True, eq=False)
class FrameModel:
    """Linear model of the closed loop with one step per frame.

    Attributes:
        system: python-control's `StateSpace` from the references to all signals, dt = one frame, SI. Signals of the log
            have their columns' names; of two signals that share one, the one not in the log ends in `_true`.
        N (n, noises), M (outputs, noises): answer to sensor noise of unit variance.
        step: fraction of the excursions used.
        convergence: change of A, in excursions, against the next fraction.
        kink: largest difference of one-sided slopes, in excursions.
        where: name of the state that shows the kink.
    """

    system: System
    N: np.ndarray
    M: np.ndarray
    step: float = 0.0
    convergence: float = 0.0
    kink: float = 0.0
    where: str = ""

    def __repr__(self) -> str:
        """Size, then what the poles say."""
        s = self.system
        return (
            f"FrameModel: {s.nstates} states, {s.ninputs} references, {s.noutputs} outputs, a frame of {s.dt:g} s\n"
            f"spectral radius {self.spectral_radius:.4f}" + ("" if self.decides else "; poles mean little (kink)")
        )

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
        return self.kink <= KINK and not self.marginal

    def poles(self) -> tuple[Pole, ...]:
        """Poles, the slowest to decay first."""
        values, right = np.linalg.eig(self.system.A)
        share = np.abs(np.linalg.pinv(right).T * right)
        order, names = np.argsort(-np.abs(values), kind="stable"), self.system.state_labels
        return tuple(Pole.from_z(complex(values[i]), self.system.dt, names[int(share[:, i].argmax())]) for i in order)

    def rows(self, kind: str, channels: Iterable[str]) -> list[int]:
        """Indices of the outputs of a kind, e.g. "tension", one for each channel."""
        return [self.system.output_labels.index(f"{kind}_{channel}") for channel in channels]


def evaluate(system: control.StateSpace, frequency: np.ndarray) -> np.ndarray:
    """Frequency response (f, outputs, inputs) [SI] at frequencies (f,) [Hz], solved many at a time."""
    z = np.exp(2j * np.pi * np.asarray(frequency, dtype=float) * system.dt)
    eye, parts = np.eye(system.nstates), np.array_split(z, max(1, len(z) // BATCH))
    a, b, c, d = (np.asarray(matrix) for matrix in (system.A, system.B, system.C, system.D))
    return c @ np.concatenate([np.linalg.solve(p[:, None, None] * eye - a, b) for p in parts]) + d


def spectral_radius(a: np.ndarray) -> float:
    """Largest modulus [-] of an eigenvalue of a matrix (n, n)."""
    return float(np.abs(np.linalg.eigvals(a)).max(initial=0.0))


def compute_noise(a: np.ndarray, n: np.ndarray, c: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Standard deviation (outputs,) [SI] of y = C x + M e in the stationary state of a stable x' = A x + N e.

    Args:
        a: (n, n).
        n: (n, noises); e is white with unit variance.
        c: (outputs, n).
        m: (outputs, noises).
    """
    covariance = n @ n.T  # P = A P A' + N N' by doubling; scipy's solver is ill-conditioned for states in SI
    while np.abs(a).max() > np.finfo(float).tiny:
        more = a @ covariance @ a.T
        covariance, a = covariance + more, a @ a
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
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(name_states(loop.robot.machine)):
        groups.setdefault(name.group, []).append(i)
    for indices in groups.values():
        size[indices] = size[indices].max()
    size[size < 1e-12] = UNMOVED
    return size


def differentiate(
    loop: FrameMap, state: np.ndarray, references: np.ndarray, size: np.ndarray, fraction: float, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Difference quotients of the frame map [SI]: rows x' then all signals w, columns x, r, e.

    Args:
        loop: the frame map.
        state: (states,) and references: (channels,) [SI], where it is differentiated.
        references: see above.
        size: excursions (states,) [SI].
        fraction: of the excursions by which each state moves.
        columns: indices in x, r, e; the other columns stay zero.

    Returns:
        The central quotients (states + w, states + channels + noises), and (forward - backward) / 2 of the same shape,
        which is zero where the map is smooth.
    """
    step, n, noises = loop.stepper(), len(state), len(loop.noises)
    after = n + len(references)
    point = np.concatenate([state, references, np.zeros(noises)])
    moves = fraction * np.concatenate([size, np.full(len(references), NUDGE * loop.loop.step), np.ones(noises)])

    def image(p: np.ndarray) -> np.ndarray:
        return np.concatenate(step(p[:n], p[n:after], p[after:]))

    here = image(point)
    central, bend = np.zeros((len(here), len(point))), np.zeros((len(here), len(point)))
    for i in columns:
        up, down = point.copy(), point.copy()
        up[i] += moves[i]
        down[i] -= moves[i]
        above, below, width = image(up), image(down), up[i] - down[i]
        central[:, i], bend[:, i] = (above - below) / width, (above + below - 2.0 * here) / width
    return central, bend


def differentiate_best(
    loop: FrameMap, state: np.ndarray, references: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Quotients (states + w, columns) [SI] with the fraction of best agreement, it, and the disagreement [excursions].

    Arguments and the first two results as in `differentiate`.
    """
    n, columns = len(state), np.arange(len(state) + len(references) + len(loop.noises))
    tried = [differentiate(loop, state, references, size, f, columns) for f in FRACTIONS]
    scaled = [central[:n, :n] * size / size[:, None] for central, _ in tried]
    gaps = [float(np.abs(a - b).max()) for a, b in pairwise(scaled)]
    best = int(np.argmin(gaps)) + 1
    return *tried[best], FRACTIONS[best], gaps[best - 1]


def find_observed(a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Indices of the states on which outputs y = C x depend, at once or later; a (n, n) and c (outputs, n) [SI]."""
    observed = np.any(c != 0.0, axis=0)
    while True:
        more = observed | np.any(a[observed] != 0.0, axis=0)
        if (more == observed).all():
            return np.flatnonzero(observed)
        observed = more


def observed_states(loop: FrameMap, state: np.ndarray, references: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Indices of the states on which the log depends, at once or later; size: excursions (states,) [SI]."""
    n = len(state)
    central, _ = differentiate(loop, state, references, size, FRACTION, np.arange(n))
    return find_observed(central[:n, :n], central[n + loop.shown_rows, :n])


def linearise(loop: FrameMap, state: np.ndarray, references: np.ndarray) -> FrameModel:
    """The linear model at a state of rest (states,), from references (channels,) [SI] to all signals."""
    machine, n = loop.robot.machine, len(state)
    size = measure_excursions(loop, state, references)
    central, bend, fraction, gap = differentiate_best(loop, state, references, size)
    a, b, e = np.split(central[:n], [n, n + len(references)], axis=1)
    keep = find_observed(a, central[n + loop.shown_rows, :n])
    left_out = np.setdiff1d(np.arange(n), keep)
    rows = {name: n + i for name, i in loop.outputs.items() if not central[n + i, left_out].any()}
    c, d, m = np.split(central[list(rows.values())], [n, n + len(references)], axis=1)
    bends = np.abs(bend[np.ix_(keep, keep)] * size[keep] / size[keep, None]).max(axis=0, initial=0.0)
    names = [name_states(machine)[i].name for i in keep]
    system = System(
        a[np.ix_(keep, keep)], b[keep], c[:, keep], d, machine.frame,
        states=[name.replace(".", "_") for name in names], inputs=list(loop.references), outputs=list(rows),
    )  # fmt: skip
    return FrameModel(system, e[keep], m, fraction, gap, float(bends.max()), names[int(bends.argmax())])


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """Operating point: the state of rest of a loop under constant references.

    Attributes:
        references: (channels,) [SI].
        state: (states,) at a frame's start.
        output: (channels,) the controlled quantity [SI].
        readings: column kind -> reading of each of its channels [SI].
        frames: simulated until rest.
        residual: largest change over one frame, in units of each state's excursion.
        steady: whether the robot's own gains brought it there, rather than gentler ones.
        slack: names of channels whose reference is above 0 and whose output is not, such as slack tendons.
    """

    references: np.ndarray
    state: np.ndarray
    output: np.ndarray
    readings: dict[str, np.ndarray]
    frames: int
    residual: float
    steady: bool
    slack: tuple[str, ...]


def measure_drift(loop: FrameMap, state: np.ndarray, references: np.ndarray) -> float:
    """Largest change [excursions] over a frame from a state (states,), of the states on which the log depends."""
    after, _ = loop.run(state, references[None, :])
    size = measure_excursions(loop, state, references)
    keep = observed_states(loop, state, references, size)
    return float(np.max(np.abs(after - state)[keep] / size[keep], initial=0.0))


def settle(loop: FrameMap, references: np.ndarray) -> tuple[np.ndarray, int, float]:
    """State (states,) [SI] at rest, or after 60 s, the frames simulated, and the drift that is left [excursions]."""
    state, rows, drift, frames = loop.start(), np.tile(references, (CHUNK, 1)), np.inf, 0
    while not drift < REST and frames < CHUNK * CHUNKS:
        state, _ = loop.run(state, rows)
        drift, frames = measure_drift(loop, state, references), frames + CHUNK
    return state, frames, drift


def operating_point(loop: FrameMap, at: Mapping[str, float] | str | None = None) -> OperatingPoint:
    """The loop at rest under references `at` [SI per channel, or the name of a point of the machine].

    Where the robot's own gains do not bring it to rest, gentle ones do; that state counts if its own keep it at rest.
    InputError where neither does, for such a loop has no operating point: drift, creep, tremor, a limit cycle.
    """
    references = resolve_references(loop, at)
    state, frames, residual = settle(loop, references)
    steady = residual < SLOW
    machine = loop.robot.machine
    if not steady:
        state, more, _ = settle(loop.with_values(loop.loop.gentle), references)
        residual, frames = measure_drift(loop, state, references), frames + more
        if not residual < SLOW:
            unit = machine.signal[loop.loop.reference].unit
            words = ", ".join(f"{name} = {r:g} {unit}" for name, r in zip(loop.channels, references))
            raise InputError(f"the loop does not come to rest at {words}: it still moves {residual:.2g} a frame")
    _, signals = loop.run(state, references[None, :])
    output = signals[0, loop.signals[loop.loop.output]]
    readings = {c.kind: signals[0, loop.signals[c.signal]] for c in machine.columns}
    slack = tuple(n for n, r, y in zip(loop.channels, references, output) if machine.reference_limits and r > 0.0 >= y)
    return OperatingPoint(references, state, output, readings, frames, residual, steady, slack)


def linearise_robot(
    robot: Robot, at: Mapping[str, float] | str | None = None
) -> tuple[FrameMap, OperatingPoint, FrameModel]:
    """The frame map of a robot, where it rests, and its linear model there. InputError as `operating_point`."""
    loop = FrameMap.of(robot)
    point = operating_point(loop, at)
    return loop, point, linearise(loop, point.state, point.references)
