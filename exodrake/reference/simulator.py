"""One robot of the reference simulator and its log: the kernels of `dynamics`, given parameters, courses and noise.

Only the equations of `physics.md` are common with exodrake's main model.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.engine.inputs import Reference
from exodrake.reference import dynamics
from exodrake.reference.dynamics import ANGLE, FRAME, INPUT_SIZE, MARKER_SHIFT, SLOT, STATE_SIZE, THETA, run
from exodrake.reference.faults import ENTRIES, inject
from exodrake.reference.robot import JOINTS, SPOOL_CONFIGURED, WIRES, RobotSpec, robot_record

NOISE_FORCE = 0.01  # N
NOISE_ANGLE = 0.005  # rad
QUANTUM_THETA = 2.0 * np.pi / (16 * 69)  # rad


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
    """At rest, every wire just taut at q0 (nominal.yaml)."""
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
        record, initial_state(record), reference.values, build.inputs, build.dropped, noise, dynamics.TOLERANCE
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
