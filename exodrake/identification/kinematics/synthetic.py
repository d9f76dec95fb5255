"""Synthetic marker recordings with known truth: a drifting hand, an index finger, fourteen markers, and faults.

At rest the finger lies along x (distal) with y dorsal and the MCP centre at the origin, so flexion is about -z and
abduction about y. The pose of a segment is the product of exponentials of the joints before it. The lengths and the PIP
and DIP gradients are the paper's; that of the MCP is smaller than the printed one, which is anatomically implausible
(`physics.md`, Table 1). Nothing here was measured.
"""

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.markers import JOINTS, SEGMENTS, Layout, Recording
from exodrake.identification.kinematics.rigid import Axis, apply, chain_pose, motion, rotation, triad_pose
from exodrake.identification.workspace import LENGTHS, SPONTANEOUS
from exodrake.simulation.protocols import smooth

MM = 1e-3
PLACES = {  # mm from the joint before the segment, at rest
    "base": ((-20, 14, 12), (-58, 16, -2), (-26, 18, -18)),
    "proximal": ((10, 11, 5), (32, 10, 0), (14, 16, -6)),
    "middle": ((4, 9, 5), (17, 8, -1), (3, 17, -2)),
    "distal": ((4, 7, 5), (18.72, 6, 0), (3, 15, -2)),
    "thumb": ((5, -40, 30), (22, -48, 20)),
}


@dataclass(frozen=True)
class Hand:
    """True parameters of a synthetic hand.

    Attributes:
        lengths: (3,) phalanx lengths [m].
        slopes: (3, 3) slopes of the MCP, PIP, DIP centres along x, y, z at rest [m/rad].
        flexion: (3, 2) ranges of motion [rad].
        abduction: (2,) range of motion [rad].
    """

    lengths: tuple[float, float, float] = LENGTHS
    slopes: tuple[tuple[float, float, float], ...] = (
        (-1.0e-3, -1.5e-3, 0),
        (-2.72e-3, 1.91e-3, 0),
        (-0.71e-3, 0.26e-3, 0),
    )
    flexion: tuple[tuple[float, float], ...] = SPONTANEOUS
    abduction: tuple[float, float] = (-0.26, 0.26)


@dataclass(frozen=True)
class Faults:
    """Faults of a synthetic recording.

    Attributes:
        noise: RMS noise per axis [m].
        artefact: Skin motion of each marker, in a random direction [m/rad].
        dropouts: Gaps per marker and minute.
        gap: Duration of a gap [s].
    """

    noise: float = 0.0
    artefact: float = 0.0
    dropouts: float = 0.0
    gap: float = 0.05


@dataclass(frozen=True)
class Truth:
    """Truth of a synthetic recording.

    Attributes:
        angles: (frames, 4) abduction, MCP, PIP, DIP [rad].
        axes: Abduction, MCP, PIP and DIP flexion, each in the frame of the proximal triad, centres normal to the axis.
        lengths: (3,) phalanx lengths [m].
    """

    angles: np.ndarray
    axes: tuple[Axis, Axis, Axis, Axis]
    lengths: tuple[float, float, float]


def synthesise(hand: Hand, faults: Faults, duration: float, rate: float, seed: int) -> tuple[Recording, Truth]:
    """Synthesise a recording and its truth; the finger rests for the first second, then moves over its ranges.

    Args:
        hand: True parameters.
        faults: Faults of the recording.
        duration: Its length [s].
        rate: Frame rate [Hz].
        seed: Of the random numbers.

    Raises:
        InputError: For a duration outside 3 s to an hour, a rate outside 5 to 1000 Hz, or faults below 0.
    """
    if not (3 <= duration <= 3600 and 5 <= rate <= 1000):
        raise InputError(f"synthesise: {duration:g} s at {rate:g} Hz, wanted 3 to 3600 s at 5 to 1000 Hz")
    for name, value in vars(faults).items():
        if not 0 <= value < np.inf:
            raise InputError(f"synthesise: {name} is {value:g}, wanted a number from 0")
    rng = np.random.default_rng(seed)
    time = np.arange(round(duration * rate)) / rate
    # angles: rest, then sines
    rise, columns = smooth((time - 1.0) / 1.5), []
    for number, (low, high) in enumerate((hand.abduction, *hand.flexion)):
        phase = 2 * np.pi * (0.19 + 0.06 * number) * time + 0.7 * number
        columns.append(rise * ((low + high) / 2 + (high - low) / 2 * np.sin(phase)))
    angles = np.stack(columns, axis=1)
    # finger at rest, the tip marker at its end
    joints = np.cumsum([0.0, hand.lengths[0], hand.lengths[1]])
    palmar, still = np.array([0.0, 0, -1]), np.zeros(3)
    bends = [Axis(palmar, np.array([x, 0, 0]), np.array(g, dtype=float)) for x, g in zip(joints, hand.slopes)]
    axes = (Axis(np.array([0.0, 1, 0]), still, still), *bends)
    rest = {name: MM * np.array(places, dtype=float) for name, places in PLACES.items()}
    rest["distal"][1, 0] = hand.lengths[2]
    for name, x in zip(SEGMENTS[1:], joints):
        rest[name] = rest[name] + np.array([x, 0, 0])
    # skin drags each marker along with the angle of the proximal joint
    places = []
    for number, name in enumerate((*SEGMENTS, "thumb")):
        before = number + 1 if 0 < number < 4 else 0
        carried = chain_pose(axes[:before], angles) if before else np.broadcast_to(np.eye(4), (len(time), 4, 4))
        nearest = angles[:, before - 1] if before else np.zeros(len(time))
        ways = rng.standard_normal((len(rest[name]), 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        places.append(apply(carried, rest[name] + faults.artefact * nearest[:, None, None] * ways))
    # the hand drifts and turns slowly
    turn = np.array([0.48, 0.6, 0.64]) * (0.7 + 0.25 * np.sin(0.7 * time))[:, None]
    waves = (0.03 * np.sin(0.6 * time), 0.02 * np.sin(0.9 * time), 0.02 * np.cos(0.5 * time))
    shift = np.array([0.4, 0.1, 0.9]) + np.stack(waves, axis=1)
    positions = apply(motion(rotation(turn), shift), np.concatenate(places, axis=1))
    positions = positions + faults.noise * rng.standard_normal(positions.shape)
    gap = max(1, round(faults.gap / (time[1] - time[0])))
    for marker in range(positions.shape[1]):
        count = rng.poisson(faults.dropouts * time[-1] / 60) if faults.dropouts else 0
        for first in rng.integers(0, len(time), size=count):
            positions[first : first + gap, marker] = np.nan
    layout = Layout()
    recording = Recording((*layout.finger, *layout.thumb), time, positions, f"synthetic, seed {seed}")
    seen = [a.seen_from(triad_pose(rest[n])) for a, n in zip(axes, ("base", *SEGMENTS[:3]), strict=True)]
    return recording, Truth(angles, tuple(seen), hand.lengths)  # type: ignore[arg-type]


def truth_yaml(truth: Truth) -> str:
    """Encode the truth as YAML: lengths [m], gradient [mm/rad] and intercept [mm] of each centre."""
    lines = ["# truth of a synthetic recording"]
    lines += [f"finger.length.{joint}: {length:.5f}" for joint, length in zip(JOINTS, truth.lengths, strict=True)]
    for joint, axis in zip(JOINTS, truth.axes[1:], strict=True):
        parts = {"gradient_mm_rad": 1e3 * axis.slope, "intercept_mm": 1e3 * axis.point, "axis": axis.direction}
        lines += [f"{joint}.{name}: [{', '.join(f'{v:.4f}' for v in vector)}]" for name, vector in parts.items()]
    return "\n".join(lines) + "\n"
