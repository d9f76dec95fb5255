"""One robot of the reference simulator: its integrator, its frames of ten slots (model.md, Timing), and its log.

Only the specification `model.md` is common with exodrake's main model. numba's cache depends on this file alone: remove
__pycache__ after a change in dynamics. The integrator is a stabilised Runge-Kutta-Chebyshev pair with error control,
restarted at every task (Sommeijer, Shampine and Verwer, J. Comput. Appl. Math. 88, 1998). The robot is stiff in a
simple way: joint damping on light phalanges makes one real rate of about -12000 1/s, the rest is slower than 1000 1/s.
A step of 2 ms costs eight slopes, no Jacobian; LSODA's memory would cost a hundred times as much in such short slots.
"""

from dataclasses import dataclass
from math import ceil, sqrt
from typing import Any

import numpy as np
from numba import njit

from exodrake.core.errors import InputError
from exodrake.engine.inputs import Reference
from exodrake.reference import dynamics
from exodrake.reference.dynamics import ANGLE, FRAME, INPUT_SIZE, MARKER_SHIFT, RATE, STATE_SIZE, THETA, derivative
from exodrake.reference.faults import ENTRIES, inject
from exodrake.reference.robot import JOINTS, SPOOL_CONFIGURED, WIRES, RobotSpec, robot_record

NOISE_FORCE = 0.01  # N
NOISE_ANGLE = 0.005  # rad
QUANTUM_THETA = 2.0 * np.pi / (16 * 69)  # rad
RELATIVE = 1e-3
RADIUS = 1.5e4  # 1/s, guess of the spectral radius, with a margin for drawn parameters
DAMPING = 2.0 / 13.0  # of the Chebyshev polynomials, as in the paper
SAFETY, SHRINK, GROW = 0.8, 0.1, 5.0
SMALLEST = 1e-9  # s
TOLERANCE = np.repeat(list(dynamics.TOLERANCES.values()), 3)  # (STATE_SIZE,) absolute tolerances [SI]


@njit(cache=True)
def chebyshev(w0, before, last):
    """Next T, T', T'' at w0 from the last two."""
    value = 2.0 * w0 * last[0] - before[0]
    slope = 2.0 * w0 * last[1] - before[1] + 2.0 * last[0]
    return value, slope, 2.0 * w0 * last[2] - before[2] + 4.0 * last[1]


@njit(cache=True)
def trial(time, y, step, p, command, inputs, work):
    """One RKC step from slope work[0]; the index of the row that holds the new state. Its slope is not yet known."""
    rows, u, torque, arms = work
    start, slope = rows[0], rows[1]
    stages = max(2, 1 + ceil(sqrt(1.0 + 1.54 * step * RADIUS)))
    w0 = 1.0 + DAMPING / stages**2
    before, last = (1.0, 0.0, 0.0), (w0, 1.0, 0.0)
    for _ in range(2, stages + 1):
        before, last = last, chebyshev(w0, before, last)
    w1 = last[1] / last[2]
    before, last = (1.0, 0.0, 0.0), (w0, 1.0, 0.0)
    b_first = 1.0 / (4.0 * w0 * w0)  # b0 = b1 = b2
    b_older, b_old = b_first, b_first
    older, old, new = 2, 3, 4
    moment = b_first * w1
    for i in range(y.size):
        rows[older, i] = y[i]
        rows[old, i] = y[i] + moment * step * start[i]
    for _ in range(2, stages + 1):
        derivative(time + moment * step, rows[old], slope, p, command, inputs, u, torque, arms)
        gone = 1.0 - b_old * last[0]
        before, last = last, chebyshev(w0, before, last)
        b = last[2] / (last[1] * last[1])
        reach = 2.0 * b * w1 / b_old
        mu, nu = 2.0 * b * w0 / b_old, -b / b_older
        rest, first, second = 1.0 - mu - nu, reach * step, -gone * reach * step
        for i in range(y.size):
            mixed = rest * y[i] + mu * rows[old, i] + nu * rows[older, i]
            rows[new, i] = mixed + first * slope[i] + second * start[i]
        moment = w1 * last[2] / last[1]
        b_older, b_old = b_old, b
        older, old, new = old, new, older
    return old


@njit(cache=True)
def advance(time, until, y, step, p, command, inputs, tolerance, work):
    """Integrate y in place from time to until [s]; returns the step to try next, or -1 if it cannot be done."""
    rows, u, torque, arms = work
    derivative(time, y, rows[0], p, command, inputs, u, torque, arms)
    left = until - time
    while left > SMALLEST:
        size = min(step, left)
        if size > 0.5 * left and size < left:
            size = 0.5 * left
        new = rows[trial(time, y, size, p, command, inputs, work)]
        derivative(time + size, new, rows[5], p, command, inputs, u, torque, arms)
        worst = 0.0  # error in units of what is tolerated
        for i in range(y.size):
            error = 0.8 * (y[i] - new[i]) + 0.4 * size * (rows[0, i] + rows[5, i])
            worst = max(worst, abs(error) / (tolerance[i] + RELATIVE * abs(new[i])))
        worst = worst if worst < 1e12 else 1e12
        factor = min(GROW, max(SHRINK, SAFETY * (worst + 1e-10) ** (-1.0 / 3.0)))
        if worst <= 1.0:
            time += size
            left = until - time
            y[:] = new
            rows[0, :] = rows[5]
            step = max(step, size * factor) if size < step else size * factor
        else:
            step = size * factor
            if step < SMALLEST:
                return -1.0
    return step


SLOT = 0.002
FULL_SCALE = 20.0  # N, where the cell's bow returns to zero (effects.md)


@njit(cache=True)
def cell_reading(p, y, wire, drift, noise, before):
    """What the bus delivers [N]: neighbour, scale, bow (skewed half sine), zero, drift, noise, sticking, rounding."""
    load = y[dynamics.CELL + wire] + p.crosstalk[wire] * y[dynamics.CELL + (wire + 1) % 3]
    reading = (1.0 + p.cell_gain[wire]) * load + p.cell_offset[wire] + drift + noise
    reading += p.cell_bow[wire] * np.sin(np.pi * (max(load, 0.0) / FULL_SCALE) ** 0.8)
    if p.sticky > 0.0 and abs(reading - before) < p.sticky:
        return before
    if p.quantum_force > 0.0:
        reading = np.round(reading / p.quantum_force) * p.quantum_force
    return reading


@njit(cache=True)
def run(p, y, reference, inputs, dropped, noise, tolerance):
    """Simulate n frames of a robot from its state y, on references (n, 3) [N] with the noise (n, 3) [N] of its cells.

    Tension (n, 3) [N], gear angle (n, 3) [rad], commands (n, 3) [m/s], and angles and rates (10 n, 6) [rad, rad/s] at
    every mid-slot; NaN from where a state cannot be integrated.
    """
    frames = reference.shape[0]
    tension, theta = np.full((frames, 3), np.nan), np.full((frames, 3), np.nan)
    commands, posture = np.full((frames, 3), np.nan), np.full((10 * frames, 6), np.nan)
    active, awake, last = np.zeros(3), np.zeros(3, np.bool_), np.zeros(3)
    # scratch: slope at the start, slope of a stage, three stages, new state; inputs, torque, arms
    work = np.zeros((6, y.size)), np.zeros(INPUT_SIZE), np.zeros(3), np.zeros((3, 3))
    step, time = 1e-4, 0.0
    for frame in range(frames):
        for slot in range(10):
            until = frame * FRAME + slot * SLOT + 0.5 * SLOT
            step = advance(time, until, y, step, p, active, inputs, tolerance, work)
            if step < 0.0:
                return tension, theta, commands, posture
            time = until
            posture[10 * frame + slot, :3] = y[ANGLE : ANGLE + 3]
            posture[10 * frame + slot, 3:] = y[RATE : RATE + 3]
            if 1 <= slot <= 3:
                wire, drift = slot - 1, inputs[frame, dynamics.CELL_DRIFT + slot - 1]
                theta[frame, wire] = y[THETA + wire]
                tension[frame, wire] = cell_reading(p, y, wire, drift, noise[frame, wire], last[wire])
            elif slot == 4:
                for wire in range(3):  # admittance law with the damping sign [m/s]
                    reading = tension[frame, wire]
                    change = 0.0 if frame == 0 else (reading - last[wire]) / FRAME
                    command = p.kp * (reference[frame, wire] - reading) - p.kd * change
                    commands[frame, wire] = min(p.speed_max, max(-p.speed_max, command))
                    last[wire] = reading
            elif 5 <= slot <= 7 and not dropped[frame, slot - 5]:
                wire, sent = slot - 5, frame - int(p.latency)  # before the first frame the command is 0
                command = commands[sent, wire] if sent >= 0 else 0.0
                if p.dead_zone[wire] > 0.0:  # small ones are ignored, with hysteresis in waking up and falling asleep
                    awake[wire] = abs(command) > p.dead_zone[wire] * (0.8 if awake[wire] else 1.2)
                    command = command if awake[wire] else 0.0
                active[wire] = command
    return tension, theta, commands, posture


@dataclass
class Build:
    """A robot being assembled for one log of n frames."""

    record: Any  # parameters [SI]
    inputs: np.ndarray  # (n + 2, INPUT_SIZE) over time [SI]
    dropped: np.ndarray  # (n, 3) whether a command is lost
    time: np.ndarray  # (n + 2,) instants of the frames [s]


def assemble(spec: RobotSpec, frames: int, rng: np.random.Generator) -> Build:
    """Assemble a robot for a log of so many frames; effects with random courses draw them from rng."""
    time = FRAME * np.arange(frames + 2)
    build = Build(
        robot_record(spec.parameters, spec.noisy), np.zeros((frames + 2, INPUT_SIZE)), np.zeros((frames, 3), bool), time
    )
    for effect in spec.effects:
        if effect.id not in ENTRIES:
            raise InputError(f"effect {effect.id!r} is not one the reference simulator knows")
        inject(build, effect, rng)
    build.record["has_inputs"] = float(np.any(build.inputs))
    return build


def initial_state(record):
    """At rest, every wire just taut at q0 (model.md, Numbers)."""
    y = np.zeros(STATE_SIZE)
    y[ANGLE : ANGLE + 3] = record["rest"]
    for wire in range(3):
        joints, rest = range(1 if wire == 1 else 3), record["rest"]
        taken = sum(
            dynamics.router(record, int(wire == 2), j, np.sin(rest[j]), np.cos(rest[j]), 0.0)[0] for j in joints
        )
        theta = taken / record["spool"][wire]
        for _ in range(8):
            length, radius = dynamics.wind(record, wire, theta)
            theta += (taken - length) / radius
        y[THETA + wire] = theta + record["homing"][wire] / record["spool"][wire]
    return y


def simulate(spec: RobotSpec, reference: Reference, seed: int | list[int]) -> dict[str, np.ndarray]:
    """Log of a robot on a motion of n frames: column name -> values (n,) [SI]; equal arguments give equal bits.

    The seed is that of noise and random courses. InputError for an unknown effect, and where integration fails.
    """
    frames = len(reference.values)
    course, noise_source = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
    build = assemble(spec, frames, course)
    record = build.record
    noise = NOISE_FORCE * spec.noisy * noise_source.standard_normal((frames, 3))
    tension, theta, commands, posture = run(
        record, initial_state(record), reference.values, build.inputs, build.dropped, noise, TOLERANCE
    )
    if not np.all(np.isfinite(posture)):
        raise InputError(
            f"{reference.name}: the robot with {[effect.id for effect in spec.effects]} cannot be integrated"
        )
    counted = theta - record["homing"] / SPOOL_CONFIGURED
    # mocap's own instants: cubic Hermite through angles and rates at every mid-slot
    instant = (FRAME * np.arange(frames) + 0.001 - record["mocap_delay"]) / (1.0 + record["mocap_skew"])
    place = np.clip((instant - 0.001) / SLOT, 0.0, len(posture) - 1.000001)
    row = place.astype(int)
    x = (place - row)[:, None]
    start, end = posture[row], posture[np.minimum(row + 1, len(posture) - 1)]
    q0, v0, q1, v1 = start[:, :3], SLOT * start[:, 3:], end[:, :3], SLOT * end[:, 3:]
    cubic = (2 * (q0 - q1) + v0 + v1) * x + 3 * (q1 - q0) - 2 * v0 - v1
    angle = ((cubic * x + v0) * x + q0) * (1.0 + record["marker_gain"]) + record["marker_offset"]
    angle = angle + build.inputs[:frames, MARKER_SHIFT : MARKER_SHIFT + 3]
    if spec.noisy:
        counted = np.round(counted / QUANTUM_THETA) * QUANTUM_THETA
        angle = angle + NOISE_ANGLE * noise_source.standard_normal(angle.shape)
    groups = [("tension_ref", reference.values, WIRES), ("tension", tension, WIRES)]
    groups += [("stroke", SPOOL_CONFIGURED * counted, WIRES), ("speed_cmd", commands, WIRES), ("angle", angle, JOINTS)]
    columns = {"time": FRAME * np.arange(frames)}
    for kind, values, names in groups:
        columns |= {f"{kind}_{name}": values[:, index].copy() for index, name in enumerate(names)}
    return columns


def warm_up() -> None:
    """Compile the kernels into numba's cache, so that several processes do not do it at once."""
    simulate(RobotSpec(), Reference(np.ones((2, 3)), "warm-up"), 0)
