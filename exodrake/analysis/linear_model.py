"""The frame map differentiated at an operating point: a linear model with one step per frame, and its poles.

    x_{n+1} = A x_n + B r_n + N e_n        y_n = C x_n + D r_n + M e_n      (deviations from the operating point)

The derivatives are central differences. Each state moves by a fraction of its own excursion under a small reference
step. The fraction is chosen where two successive ones agree best. States on which no output depends, however late, are
left out: clocks, unread memories, the bus's old commands. Such states give exact zeros, since a run is deterministic.
With them, a shift register of m frames would make A defective, and its zero poles would appear at about (1e-16)^(1/m).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from exodrake.analysis.frame_map import FrameMap, state_names

NUDGE = 0.02  # reference step that measures excursions, as a share of the loop's step
FRAMES = 8  # frames of it
UNMOVED = 1e-3  # excursion assumed of a state that does not move
FRACTIONS = (0.5, 0.25, 0.1, 0.05, 0.02)
FRACTION = 0.05  # where one will do
OUTSIDE = 1e-6  # width of the ring about the unit circle in which poles count as neither in nor out
KINK = 0.02  # one-sided slopes that differ by more deserve a word


def excursions(loop: FrameMap, state: np.ndarray, references: np.ndarray) -> np.ndarray:
    """Largest excursion of each state (states,) [SI] over small steps of all references."""
    names = state_names(loop.robot.machine)
    size = np.zeros(len(state))
    for i in range(len(references)):
        rows = references.copy()
        rows[i] += NUDGE * loop.loop.step
        moved, still = state, state
        for _ in range(FRAMES):
            moved, _ = loop.run(moved, rows[None, :])
            still, _ = loop.run(still, references[None, :])
            size = np.maximum(size, np.abs(moved - still))
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        groups.setdefault(name.group, []).append(i)
    for places in groups.values():
        size[places] = size[places].max()
    size[size < 1e-12] = UNMOVED
    return size


@dataclass(frozen=True, eq=False)
class Slopes:
    """Difference quotients of the frame map, in SI.

    Attributes:
        central: (states + w, states + channels + noises): rows x' then all signals w, columns x, r, e.
        bend: same shape: (forward - backward) / 2; zero where the map is smooth.
    """

    central: np.ndarray
    bend: np.ndarray


def differences(
    loop: FrameMap, state: np.ndarray, references: np.ndarray, size: np.ndarray, fraction: float, columns: np.ndarray
) -> Slopes:
    """Slopes in some columns (indices in x, r, e); the others stay zero. size: excursions (states,) [SI]."""
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
    return Slopes(central, bend)


def matters(a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Indices of the states on which outputs y = C x depend, at once or later; a (n, n) and c (outputs, n) [SI]."""
    used = np.any(c != 0.0, axis=0)
    while True:
        more = used | np.any(a[used] != 0.0, axis=0)
        if (more == used).all():
            return np.flatnonzero(used)
        used = more


def used(loop: FrameMap, state: np.ndarray, references: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Indices of the states on which the log depends, at once or later; size: excursions (states,) [SI]."""
    n = len(state)
    central = differences(loop, state, references, size, FRACTION, np.arange(n)).central
    return matters(central[:n, :n], central[n + output_rows(loop)[0], :n])


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


@dataclass(frozen=True, eq=False)
class FrameModel:
    """Linear model of the loop, one step per frame.

    Attributes:
        A (n, n), B (n, channels), C (outputs, n), D (outputs, channels): SI.
        period: frame period [s].
        states, inputs, outputs: names; outputs are log columns.
        step: fraction of the excursions used.
        convergence: change of A, in excursions, against the next fraction.
        kink: largest difference of one-sided slopes, in excursions.
        where: name of the state that shows the kink.
        N (n, noises), M (outputs, noises): answer to sensor noise of unit variance.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    period: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    step: float = 0.0
    convergence: float = 0.0
    kink: float = 0.0
    where: str = ""
    N: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    M: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def spectral_radius(self) -> float:
        """Largest modulus of a pole; below 1 the loop is stable."""
        return spectral_radius(self.A)

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
        values, right = np.linalg.eig(self.A)
        share = np.abs(np.linalg.pinv(right).T * right)
        order = np.argsort(-np.abs(values), kind="stable")
        return tuple(pole_of(complex(values[i]), self.period, self.states[int(share[:, i].argmax())]) for i in order)

    def response(self, frequency: np.ndarray) -> np.ndarray:
        """Frequency response (f, outputs, inputs) at frequencies (f,) [Hz]."""
        z = np.exp(2j * np.pi * np.asarray(frequency, dtype=float) * self.period)
        eye = np.eye(len(self.A))
        return np.array([self.C @ np.linalg.solve(zz * eye - self.A, self.B) + self.D for zz in z])

    def select(self, *kinds: str) -> FrameModel:
        """The model with the outputs of these column kinds only, e.g. "tension", "angle"."""
        rows = [i for i, name in enumerate(self.outputs) if name.rsplit("_", 1)[0] in kinds]
        noise = self.M[rows] if self.M.size else self.M
        return replace(self, C=self.C[rows], D=self.D[rows], M=noise, outputs=tuple(self.outputs[i] for i in rows))


def spectral_radius(a: np.ndarray) -> float:
    """Largest modulus [-] of an eigenvalue of a matrix (n, n)."""
    return float(np.abs(np.linalg.eigvals(a)).max(initial=0.0))


def output_noise(a: np.ndarray, n: np.ndarray, c: np.ndarray, m: np.ndarray) -> np.ndarray:
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


ON_CIRCLE = 1e-9  # of |z|: what rounding leaves of an eigenvalue on the unit circle [-]


def pole_of(z: complex, period: float, state: str = "") -> Pole:
    """A pole with its continuous-time reading s = ln(z) / T."""
    if abs(z) < 1e-12:
        return Pole(z, np.inf, 1.0, 0.0, state)
    s = np.log(z) / period
    decay = np.inf if abs(abs(z) - 1.0) < ON_CIRCLE else -1.0 / s.real
    damping = -s.real / abs(s) if s != 0.0 else 0.0
    return Pole(z, float(abs(s)) / (2.0 * np.pi), float(damping), float(decay), state)


def best_slopes(
    loop: FrameMap, state: np.ndarray, references: np.ndarray, size: np.ndarray
) -> tuple[Slopes, float, float]:
    """Slopes with the step of best agreement, that step in excursions (states,) [SI], and the disagreement."""
    n, columns = len(state), np.arange(len(state) + len(references) + len(loop.noises))
    tried = [differences(loop, state, references, size, f, columns) for f in FRACTIONS]
    scaled = [t.central[:n, :n] * size / size[:, None] for t in tried]
    gaps = [float(np.abs(a - b).max()) for a, b in pairwise(scaled)]
    best = int(np.argmin(gaps)) + 1
    return tried[best], FRACTIONS[best], gaps[best - 1]


def output_rows(loop: FrameMap) -> tuple[np.ndarray, tuple[str, ...]]:
    """Indices (outputs,) [-] in w of the log's columns, references excepted, and their names."""
    machine = loop.robot.machine
    columns = [c for c in machine.columns if c.signal not in machine.inputs]
    rows = np.concatenate([np.arange(loop.signals[c.signal].start, loop.signals[c.signal].stop) for c in columns])
    return rows, tuple(machine.log_names(columns))


def linearise(loop: FrameMap, state: np.ndarray, references: np.ndarray) -> FrameModel:
    """The linear model at a state of rest (states,), from references (channels,) [SI] to the log's columns."""
    machine, n = loop.robot.machine, len(state)
    size = excursions(loop, state, references)
    slopes, fraction, gap = best_slopes(loop, state, references, size)
    rows, outputs = output_rows(loop)
    a, b, e = np.split(slopes.central[:n], [n, n + len(references)], axis=1)
    c, d, m = np.split(slopes.central[n + rows], [n, n + len(references)], axis=1)
    keep = matters(a, c)
    bends = np.abs(slopes.bend[np.ix_(keep, keep)] * size[keep] / size[keep, None]).max(axis=0, initial=0.0)
    names = tuple(state_names(machine)[i].name for i in keep)
    return FrameModel(
        a[np.ix_(keep, keep)], b[keep], c[:, keep], d, machine.frame, names,
        tuple(f"{loop.loop.reference}_{channel}" for channel in loop.channels), outputs,
        fraction, gap, float(bends.max()), names[int(bends.argmax())], e[keep], m,
    )  # fmt: skip
