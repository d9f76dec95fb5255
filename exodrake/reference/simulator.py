"""One robot of the reference simulator: what it is made of, and the log it leaves.

    slack = InjectedFault("tendon.slack", wires=("MF",), parameters={"length": 0.002})
    spec = RobotSpec(parameters=draw_parameters(rng), effects=(slack,))
    columns = simulate(spec, Protocol("grasps", reference), seed=7)

No equation of exodrake's main model is used here: only the specification `model.md` is common to both.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.reference.parameters import (
    NOISE_ANGLE,
    NOISE_FORCE,
    QUANTUM_THETA,
    SPOOL_CONFIGURED,
    robot_record,
)
from exodrake.reference.records import (
    ANGLE,
    INPUT_SIZE,
    JOINTS,
    MARKER_SHIFT,
    STATE_SIZE,
    THETA,
    WIRES,
    tolerance_vector,
)
from exodrake.reference.robot_spec import FRAME, Protocol, RobotSpec


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
    from exodrake.reference.catalogue import INJECTORS

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
    from exodrake.reference.tendons import router, wound

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
    from exodrake.reference.control_loop import run

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
