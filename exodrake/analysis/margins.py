"""Stability margins of a sampled loop: gain, phase, delay and disk margins, delay budget, maps over gains and latency.

Margins of an unstable loop mean nothing and are NaN. Poles decide whether a loop is stable.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import control
import numpy as np
from scipy.optimize import minimize

from exodrake.analysis import linear_model as lm
from exodrake.analysis.responses import first_crossing
from exodrake.core.errors import InputError, short_repr
from exodrake.model.part import Part

LEAST_GAIN = 1e-3  # factor on the loop gain below which a lower margin counts as none
ALMOST_REAL = 0.02  # share of |L| below which its imaginary part at the lowest frequency counts as 0
DECOUPLED, FAR = 1e-20, 1e6  # share of squared coupling that scales nothing; bound of scalings
BALANCINGS, BALANCED = 30, 1e-9  # rounds over all channels at most; relative change of scalings that ends them
TIGHT = 1e-6  # of the search for scalings
GAINS = 31  # points along each gain of the stability map
LATENCIES = np.arange(0.0, 8.01, 0.25)  # frames


def open_loop(model: lm.FrameModel) -> lm.System:
    """A loop opened at its commands (`break_loop`). InputError where a command ignores its reference (a gain of 0)."""
    v, y = model.rows(model.loop.loop.command), model.rows(model.loop.loop.measured)
    return break_loop(model.system, model.loop.own[model.keep], v, y)


def break_loop(system: lm.System, own: np.ndarray, v: list[int], y: list[int]) -> lm.System:
    """A closed loop opened at its commands, from those that the plant gets to those sent, then to the readings.

    A reference enters the controller alone, and the command answers within the frame: dv/dr = D. So a command u acts
    on the plant like a reference D^-1 u, and not on the controller's states. `close` closes the loop again.

        B = B_r D^-1, 0 in the controller's states         A = A_closed - B C         L(z) = -C (z - A)^-1 B

    `own` is a mask (states,) [-] of the controller's states; v and y are indices of commands and readings among the
    outputs.
    """
    direct, commands = system.D[v], [system.output_labels[i] for i in v]
    if (np.abs(direct).max(axis=1) == 0.0).any() or np.linalg.cond(direct) > 1e12:
        raise InputError(f"{commands[0]} does not answer to its reference (kp = 0): there is no loop to break")
    b, d = system.B @ np.linalg.inv(direct), system.D @ np.linalg.inv(direct)
    b[own], d[v], rows = 0.0, 0.0, v + y
    return lm.System(
        system.A - b @ system.C[v], b, system.C[rows] - d[rows] @ system.C[v], d[rows], system.dt,
        states=system.state_labels, inputs=commands, outputs=[system.output_labels[i] for i in rows],
    )  # fmt: skip


def close(whole: lm.System, gain: np.ndarray | float = 1.0) -> np.ndarray:
    """A (n, n) [SI] of an open loop closed with factors (channels,) [-] on the commands."""
    m = whole.ninputs
    return whole.A + whole.B @ (np.broadcast_to(gain, (m,))[:, None] * whole.C[:m])


def open_channel(whole: lm.System, channel: int) -> lm.System:
    """The loop of one channel opened, the others closed: from its command to its command and its reading."""
    others, rows = np.arange(whole.ninputs) != channel, [channel, whole.ninputs + channel]
    return lm.System(close(whole, others), whole.B[:, [channel]], whole.C[rows], 0.0, whole.dt)


def open_responses(whole: lm.System, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ratio L [-] and readings by commands P, (f, channels, channels) each, at frequencies (f,) [Hz]."""
    commands, readings = np.split(lm.evaluate(whole, frequency), 2, axis=1)
    return -commands, readings


def frequency_grid(whole: lm.System) -> np.ndarray:
    """Frequencies (f,) [Hz] up to the Nyquist frequency, dense where margins are read."""
    top = 0.5 / whole.dt
    return np.concatenate([np.geomspace(4e-5 * top, 0.04 * top, 300), np.linspace(0.04, 1.0, 1500)[1:] * top])


@short_repr
@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of one channel's open loop L; NaN where the closed loop is unstable."""

    channel: str
    frequency: np.ndarray = field(repr=False)  # (n,) [Hz]
    loop: np.ndarray = field(repr=False)  # L (n,) [-]
    gain_margin_db: float  # gain above 0 dB at the limit of stability
    gain_low_db: float  # gain below 0 dB at which a conditionally stable loop loses stability; -inf without
    phase_margin_deg: float  # at the crossover with the least delay margin
    crossover: float  # [Hz]
    delay_margin: float  # extra delay at the limit [s]
    disk_margin: float  # gain and phase at once, balanced (`disk_margin`)
    peak_sensitivity: float  # largest |S|; its inverse is the distance of L from -1
    open_unstable: int  # poles outside the unit circle
    closed_unstable: int

    @property
    def acts(self) -> bool:
        """Whether the command acts on the reading."""
        return bool(self.loop.any())

    @property
    def encirclements(self) -> int:
        """Counter-clockwise encirclements of -1 by L, by Nyquist's criterion."""
        return self.open_unstable - self.closed_unstable


def decibel(size: Any) -> Any:
    """Amplitude ratio, a number or (n,) [-], in dB; -inf of 0."""
    with np.errstate(divide="ignore"):
        return 20.0 * np.log10(size)


def margins(whole: lm.System, channel: int, name: str = "") -> Margins:
    """Margins of a channel's loop (its index); NaN where the closed loop is unstable."""
    one, frequency = open_channel(whole, channel), frequency_grid(whole)
    response = open_responses(one, frequency)[0][:, 0, 0]
    unstable = [int((np.abs(np.linalg.eigvals(a)) > 1.0 + lm.OUTSIDE).sum()) for a in (one.A, close(one))]
    if unstable[1] or not np.abs(response).max() > 0.0:
        return Margins(name, frequency, response, *(np.nan,) * 7, *unstable)  # pyright: ignore
    low, high, phase, crossover, late = loop_margins(frequency, response)
    sensitivity = 1.0 / (1.0 + response)
    return Margins(
        name, frequency, response, float(decibel(high)), float(decibel(low)), phase, crossover, late,
        float(disk_margin(sensitivity[:, None, None]).min()), float(np.abs(sensitivity).max()), *unstable,
    )  # fmt: skip


def loop_margins(frequency: np.ndarray, loop: np.ndarray) -> tuple[float, float, float, float, float]:
    """Margins of a loop L (n,) [-], sampled at frequencies (n,) [Hz] up to Nyquist, where it is real.

    They are the largest factor < 1 and the smallest > 1 that put L on -1, 0 and inf without any; phase margin [deg],
    crossover [Hz] and delay margin [s] at the crossover with the least delay margin, inf, nan and inf without any.
    """
    gains, phases, _, _, crossovers, _ = control.stability_margins(
        control.frd(loop, 2.0 * np.pi * frequency), returnall=True
    )
    ends = [loop[-1].real]
    if abs(loop[0].imag) < ALMOST_REAL * abs(loop[0].real):  # a loop without integrator begins on the real axis
        ends.append(loop[0].real)
    factors = np.array([*gains, *(-1.0 / real for real in ends if real < 0.0)])
    low = float(factors[(factors > LEAST_GAIN) & (factors < 1.0)].max(initial=0.0))
    high = float(factors[factors > 1.0].min(initial=np.inf))
    if not len(crossovers):
        return low, high, np.inf, np.nan, np.inf
    phase, w = min(zip(np.asarray(phases) % 360.0, crossovers), key=lambda pair: pair[0] / pair[1])
    return low, high, float(phase), float(w / (2.0 * np.pi)), float(np.radians(phase) / w)


def disk_margin(sensitivity: np.ndarray) -> np.ndarray:
    """Balanced disk margin (f,) [-] of sensitivities S (f, channels, channels) [-], for all channels at once.

    Each command j passes (1 + d_j / 2) / (1 - d_j / 2), d_j complex with |d_j| < alpha. The loop stays stable for all
    of them if and only if alpha max mu((S - T) / 2) < 1 over all frequencies, mu for diagonal uncertainty. The bound
    min sigma_max(Q M Q^-1) over diagonal Q > 0 is mu itself for up to three channels, and above it for more. alpha
    covers gains from (2 - alpha) / (2 + alpha) to its inverse and phases to 2 atan(alpha / 2) (Seiler, Packard, Gahinet
    2020). The least margin is exact, others may be a little pessimistic. python-control needs slycot, a Fortran package
    without wheels, for more than one channel.
    """
    balanced = sensitivity - 0.5 * np.eye(sensitivity.shape[-1])  # (S - T) / 2 with T = I - S
    bound, scales = structured_bound(balanced)
    done: set[int] = set()

    def size(logs: np.ndarray, m: np.ndarray) -> float:
        scale = np.exp(np.append(0.0, logs))
        return float(np.linalg.norm(scale[:, None] * m / scale, 2))

    while sensitivity.shape[-1] > 1 and (worst := int(bound.argmax())) not in done:  # else it is exact
        logs = np.log(scales[worst, 1:] / scales[worst, 0])
        for _ in range(3):  # the largest singular value has kinks: start again where the simplex ended
            options = {"xatol": TIGHT, "fatol": TIGHT}
            found = minimize(size, logs, (balanced[worst],), method="Nelder-Mead", options=options)
            logs, bound[worst] = found.x, min(bound[worst], found.fun)
        done.add(worst)
    return 1.0 / np.maximum(bound, np.finfo(float).tiny)


def structured_bound(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest singular value (f,) [-] of matrices (f, k, k) [-] under balancing scalings (f, k) [-], and these."""
    k = m.shape[-1]
    coupling, square = np.abs(m) ** 2, np.ones(m.shape[:2])  # square: of the scalings
    least = DECOUPLED * coupling.max(axis=(1, 2), initial=0.0)
    coupling[:, range(k), range(k)] = 0.0
    for _ in range(BALANCINGS if k > 1 else 0):
        before = square.copy()
        for i in range(k):
            row = np.einsum("fj,fj->f", coupling[:, i], 1.0 / square) * square[:, i] + least
            column = np.einsum("fj,fj->f", coupling[:, :, i], square) / square[:, i] + least
            square[:, i] = np.clip(square[:, i] * np.sqrt(column / row), FAR**-2, FAR**2)
        if np.abs(square / before - 1.0).max() < BALANCED:
            break
    scale = np.sqrt(square)
    return np.linalg.norm(scale[:, :, None] * m / scale[:, None, :], 2, axis=(-2, -1)), scale


@short_repr
@dataclass(frozen=True)
class DelayBudget:
    """Delays of one channel between a reading and its command [s], and the further delay that is allowed.

    A task runs in the middle of its slot. One that comes before what it reads has the value of the frame before.
    """

    channel: str
    slots: tuple[int, int, int]  # of reading, law and command
    to_control: float
    to_write: float
    hold: float  # half a frame, of a command
    margin: float  # nan if the loop is unstable, inf if there is none
    spare_slots: float  # by which the command may be late at the limit of stability

    @property
    def total(self) -> float:
        """Delay that the schedule costs [s]."""
        return self.to_control + self.to_write + self.hold


def delay_budget(loop: lm.FrameMap, margins: tuple[Margins, ...]) -> tuple[DelayBudget, ...]:
    """The delay budget of every channel."""
    machine, kinds = loop.robot.machine, loop.loop

    def find_slot(parts: list[Part], channel: int, default: int, reads: str = "") -> int:
        """Slot of the first task of the parts that has one, and reads a signal."""
        tasks = (t for part in parts for t in part.tasks if t.slots and (not reads or reads in t.reads))
        return next((t.slots[channel] if t.per_channel else t.slots[0] for t in tasks), default)

    law, sensor = (
        [next(p for p in machine.parts if any(signal in output.writes for output in p.outputs))]
        for signal in (kinds.command, kinds.measured)
    )
    others, budgets = [part for part in machine.parts if part.name != kinds.part], []
    for k, m in enumerate(margins):
        control = find_slot(law, k, 0)
        read = find_slot(sensor, k, control)
        write = find_slot(others, k, control, kinds.command)  # the default: a plant that reads the command at once
        slots, spare = (read, control, write), m.delay_margin / machine.slot
        to_control, to_write = ((b - a) % machine.slots * machine.slot for a, b in pairwise(slots))
        hold = 0.5 * machine.frame
        budgets.append(DelayBudget(m.channel, slots, to_control, to_write, hold, m.delay_margin, spare))
    return tuple(budgets)


@short_repr
@dataclass(frozen=True, eq=False)
class StabilityMap:
    """Spectral radius over two gains, and the robot's own values."""

    names: tuple[str, str]
    first: np.ndarray  # (m,) [SI]
    second: np.ndarray  # (n,) [SI]
    radius: np.ndarray  # (n, m) [-]
    nominal: tuple[float, float]
    limit: np.ndarray  # (n,) first gain up to which the loop is stable; nan beyond the map, 0 where none is


@short_repr
@dataclass(frozen=True, eq=False)
class LatencySweep:
    """Spectral radius over command latency that is added on all channels."""

    frames: np.ndarray  # (n,)
    radius: np.ndarray  # (n,) [-]
    limit: float  # [frames] or nan


def stability_limit(x: np.ndarray, radius: np.ndarray) -> float:
    """Abscissa x (n,) [-] at which the radius (n,) first passes 1 upwards; 0 if never below 1, NaN if never above."""
    below = np.flatnonzero(radius < 1.0)
    return first_crossing(x[below[0] :], radius[below[0] :], 1.0) if len(below) else 0.0


def radius_at(loop: lm.FrameMap, model: lm.FrameModel, keep: np.ndarray) -> float:
    """Spectral radius [-] of a frame map where the model rests, from its states `keep` (n,)."""
    point = model.point
    central, _ = lm.differentiate(loop, point.state, point.references, model.size, lm.FRACTION, keep)
    return lm.spectral_radius(central[np.ix_(keep, keep)])


def stability_map(model: lm.FrameModel) -> StabilityMap:
    """The map over the loop's two gains, under all of which it rests in the same state."""
    loop, point = model.loop, model.point
    across, up = loop.loop.gains
    names = (across.parameter, up.parameter)
    nominal = tuple(float(loop.parameters[loop.robot.indices(name)[0]]) for name in names)
    x = np.linspace(across.low, across.high, GAINS)[across.low == 0.0 :]  # a gain of 0 leaves no loop
    y = np.linspace(up.low, up.high, GAINS)
    largest = loop.with_values({names[0]: x.max(), names[1]: np.abs(y).max()})
    keep = lm.find_observed_states(largest, point.state, point.references, model.size)
    pairs = [[loop.with_values({names[0]: a, names[1]: b}) for a in x] for b in y]
    radius = np.array([[radius_at(there, model, keep) for there in row] for row in pairs])
    limit = np.array([stability_limit(x, row) for row in radius])
    return StabilityMap(names, x, y, radius, (nominal[0], nominal[1]), limit)


def latency_sweep(model: lm.FrameModel) -> LatencySweep | None:
    """Spectral radius over latency (n,) [frames] added to all commands; None where the loop names no such effect."""
    loop, point, radii = model.loop, model.point, []
    if not (name := loop.loop.latency):
        return None
    own = loop.parameters[loop.robot.indices(name)[0]]
    for added in LATENCIES:
        late = loop.with_values({name: own + added})
        keep = lm.find_observed_states(late, point.state, point.references, model.size)
        radii.append(radius_at(late, model, keep))
    radius = np.array(radii)
    return LatencySweep(LATENCIES, radius, stability_limit(LATENCIES, radius))
