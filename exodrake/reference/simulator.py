"""One robot of the reference simulator: its frames of ten slots (model.md, Timing) and the log that it leaves.

    slack = InjectedFault("tendon.slack", wires=("MF",), parameters={"length": 0.002})
    spec = RobotSpec(parameters=draw_parameters(rng), effects=(slack,))
    columns = simulate(spec, Protocol("grasps", reference), seed=7)

No equation of exodrake's main model is used here: only the specification `model.md` is common to both. numba's cache of
`run` depends on this file alone: remove __pycache__ after a change in dynamics or integrate.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from exodrake.core.errors import InputError
from exodrake.reference.dynamics import router, wound
from exodrake.reference.faults import INJECTORS
from exodrake.reference.integrate import advance, workspace
from exodrake.reference.robot import (
    ANGLE,
    CELL,
    CELL_DRIFT,
    FRAME,
    INPUT_SIZE,
    JOINTS,
    MARKER_SHIFT,
    NOISE_ANGLE,
    NOISE_FORCE,
    QUANTUM_THETA,
    RATE,
    SPOOL_CONFIGURED,
    STATE_SIZE,
    THETA,
    WIRES,
    Protocol,
    RobotSpec,
    robot_record,
    tolerance_vector,
)

SLOT = 0.002
FULL_SCALE = 20.0  # N, where the cell's bow returns to zero (effects.md)


@njit(cache=True)
def cell_reading(p, y, wire, drift, noise, before):
    """What the bus delivers [N]: neighbour, scale, bow (skewed half sine), zero, drift, noise, sticking, rounding."""
    load = y[CELL + wire] + p.crosstalk[wire] * y[CELL + (wire + 1) % 3]
    reading = (1.0 + p.cell_gain[wire]) * load + p.cell_offset[wire] + drift + noise
    reading += p.cell_bow[wire] * np.sin(np.pi * (max(load, 0.0) / FULL_SCALE) ** 0.8)
    if p.sticky > 0.0 and abs(reading - before) < p.sticky:
        return before
    if p.quantum_force > 0.0:
        reading = np.round(reading / p.quantum_force) * p.quantum_force
    return reading


@njit(cache=True)
def control(p, wanted, reading, before, first):
    """Admittance law with the damping sign [m/s]."""
    change = 0.0 if first else (reading - before) / FRAME
    command = p.kp * (wanted - reading) - p.kd * change
    return min(p.speed_max, max(-p.speed_max, command))


@njit(cache=True)
def command(p, reference, tension, last, commands, first):
    """Write the commands (3,) [m/s] to all drives from references and tensions (3,) [N]; `last` keeps the tensions."""
    for wire in range(3):
        commands[wire] = control(p, reference[wire], tension[wire], last[wire], first)
        last[wire] = tension[wire]


@njit(cache=True)
def send(p, wire, sent, commands, active, awake):
    """Hand the command of frame `sent` to a drive; before the first frame it is 0."""
    active[wire] = heard(p, wire, commands[sent, wire] if sent >= 0 else 0.0, awake)


@njit(cache=True)
def heard(p, wire, command, awake):
    """Command the drive acts on: small ones are ignored, with hysteresis in waking up and falling asleep."""
    if p.dead_zone[wire] <= 0.0:
        return command
    threshold = p.dead_zone[wire] * (0.8 if awake[wire] else 1.2)
    awake[wire] = abs(command) > threshold
    return command if awake[wire] else 0.0


@njit(cache=True)
def run(p, y, reference, inputs, dropped, noise, tolerance):
    """Simulate n frames.

    Args:
        p: Record of the robot.
        y: State (STATE_SIZE,) [SI], changed in place.
        reference: (n, 3) tension references [N].
        inputs: (n + 2, INPUT_SIZE) time-varying inputs [SI].
        dropped: (n, 3) commands that are lost.
        noise: (n, 3) noise of the cells [N].
        tolerance: (STATE_SIZE,) absolute tolerances [SI].

    Returns:
        Tension (n, 3) [N], gear angle (n, 3) [rad], commands (n, 3) [m/s], and angles and rates (10 n, 6) [rad, rad/s]
        at every mid-slot; NaN from where a state cannot be integrated.
    """
    frames = reference.shape[0]
    tension, theta = np.full((frames, 3), np.nan), np.full((frames, 3), np.nan)
    commands, posture = np.full((frames, 3), np.nan), np.full((10 * frames, 6), np.nan)
    active, awake, last = np.zeros(3), np.zeros(3, np.bool_), np.zeros(3)
    work = workspace(y.size)
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
                wire, drift = slot - 1, inputs[frame, CELL_DRIFT + slot - 1]
                theta[frame, wire] = y[THETA + wire]
                tension[frame, wire] = cell_reading(p, y, wire, drift, noise[frame, wire], last[wire])
            elif slot == 4:
                command(p, reference[frame], tension[frame], last, commands[frame], frame == 0)
            elif 5 <= slot <= 7 and not dropped[frame, slot - 5]:
                send(p, slot - 5, frame - int(p.latency), commands, active, awake)
    return tension, theta, commands, posture


@dataclass
class Build:
    """A robot being assembled for one log of n frames.

    Attributes:
        record: Parameter record [SI].
        inputs: (n + 2, INPUT_SIZE) time-varying inputs [SI].
        dropped: (n, 3) commands that are lost.
        time: (n + 2,) instants of the frames [s].
        delay: Delay of motion capture [s].
        skew: Relative error of its clock [-].
    """

    record: Any
    inputs: np.ndarray
    dropped: np.ndarray
    time: np.ndarray
    delay: float = 0.0
    skew: float = 0.0


def assemble(spec: RobotSpec, frames: int, rng: np.random.Generator) -> Build:
    """Assemble a robot for a log of so many frames; effects with random courses draw them from rng."""
    time = FRAME * np.arange(frames + 2)
    build = Build(
        robot_record(spec.parameters, spec.noisy), np.zeros((frames + 2, INPUT_SIZE)), np.zeros((frames, 3), bool), time
    )
    for effect in spec.effects:
        if effect.id not in INJECTORS:
            raise InputError(f"effect {effect.id!r} is not one the reference simulator knows")
        INJECTORS[effect.id](build, effect, rng)
    build.record["has_inputs"] = float(np.any(build.inputs))
    return build


def initial_state(record):
    """At rest, every wire just taut at q0 (model.md, Numbers)."""
    y = np.zeros(STATE_SIZE)
    y[ANGLE : ANGLE + 3] = record["rest"]
    for wire in range(3):
        joints = range(1 if wire == 1 else 3)
        rest = record["rest"]
        taken = sum(router(record, int(wire == 2), j, np.sin(rest[j]), np.cos(rest[j]), 0.0)[0] for j in joints)
        theta = taken / record["spool"][wire]
        for _ in range(8):
            length, radius = wound(record, wire, theta)
            theta += (taken - length) / radius
        y[THETA + wire] = theta + record["homing"][wire] / record["spool"][wire]
    return y


def mocap(build, posture, frames):
    """Angles (n, 3) at the mocap's own instants: cubic Hermite through angles and rates at every mid-slot."""
    label = FRAME * np.arange(frames) + 0.001
    instant = (label - build.delay) / (1.0 + build.skew)
    place = np.clip((instant - 0.001) / 0.002, 0.0, len(posture) - 1.000001)
    row = place.astype(int)
    x = (place - row)[:, None]
    start, end = posture[row], posture[np.minimum(row + 1, len(posture) - 1)]
    q0, v0, q1, v1 = start[:, :3], 0.002 * start[:, 3:], end[:, :3], 0.002 * end[:, 3:]
    cubic = (2 * (q0 - q1) + v0 + v1) * x + 3 * (q1 - q0) - 2 * v0 - v1
    return (cubic * x + v0) * x + q0


def measure(build, posture, theta, rng, noisy):
    """Encoder strokes [m] and marker angles [rad] as logged."""
    frames = len(theta)
    record = build.record
    counted = theta - record["homing"] / SPOOL_CONFIGURED
    if noisy:
        counted = np.round(counted / QUANTUM_THETA) * QUANTUM_THETA
    angles = mocap(build, posture, frames) * (1.0 + record["marker_gain"]) + record["marker_offset"]
    angles = angles + build.inputs[:frames, MARKER_SHIFT : MARKER_SHIFT + 3]
    if noisy:
        angles = angles + NOISE_ANGLE * rng.standard_normal(angles.shape)
    return SPOOL_CONFIGURED * counted, angles


def simulate(spec: RobotSpec, protocol: Protocol, seed: int | list[int]) -> dict[str, np.ndarray]:
    """Simulate the log of one motion; equal arguments give equal bits.

    Args:
        spec: Robot.
        protocol: Motion of n frames.
        seed: Seed of noise and random courses.

    Returns:
        Column name -> values (n,) [SI].

    Raises:
        InputError: For an unknown effect, or a robot that cannot be integrated.
    """
    reference = np.ascontiguousarray(protocol.reference, float)
    frames = len(reference)
    course, noise_source = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
    build = assemble(spec, frames, course)
    noise = NOISE_FORCE * spec.noisy * noise_source.standard_normal((frames, 3))
    results = run(
        build.record, initial_state(build.record), reference, build.inputs, build.dropped, noise, tolerance_vector()
    )
    tension, theta, commands, posture = results
    if not np.all(np.isfinite(posture)):
        raise InputError(
            f"{protocol.name}: the robot with {[effect.id for effect in spec.effects]} cannot be integrated"
        )
    stroke, angles = measure(build, posture, theta, noise_source, spec.noisy)
    columns = {"time": FRAME * np.arange(frames)}
    groups = [("tension_ref", reference, WIRES), ("tension", tension, WIRES), ("stroke", stroke, WIRES)]
    for kind, values, names in [*groups, ("speed_cmd", commands, WIRES), ("angle", angles, JOINTS)]:
        columns |= {f"{kind}_{name}": values[:, index].copy() for index, name in enumerate(names)}
    return columns


def warm_up() -> None:
    """Compile the kernels into numba's cache, so that several processes do not do it at once."""
    simulate(RobotSpec(), Protocol("warm-up", np.full((2, 3), 1.0)), 0)
