"""Motions of a case: tension references (n, 3) [N] at 20 ms.

They are like those in data/reference, but in another order, at other levels and paces; `share` is the duration relative
to the usual one. Sweeps, chirp and holds are for fitting. Held out are grasps or, sometimes, a smooth random motion of
all wires that resembles nothing in the fit.
"""

import numpy as np

from exodrake.reference.parameters import TENSION_MAX, TENSION_MIN
from exodrake.reference.robot_spec import FRAME, Protocol

SEGMENT = 5.0  # s, one sweep up and down (physics.md claim 13)
HOLD = 8.0  # s, mean duration of one level
SWEEPS, CHIRP, HOLDS, GRASPS = 60.0, 36.0, 40.0, 40.0  # s
LEVELS = np.array([0.0, 1 / 3, 2 / 3, 1.0])


def clock(duration: float) -> np.ndarray:
    """Instants of the frames (n,) [s]."""
    return FRAME * np.arange(round(duration / FRAME))


def sweeps(rng: np.random.Generator, share: float = 1.0) -> Protocol:
    """Triangles: each wire ramps four times from the anti-slack tension to its maximum and back.

    The other wires stand at levels of their maxima.
    """
    time = clock(share * SWEEPS)
    reference = np.zeros((len(time), 3))
    active = np.repeat(rng.permutation(3), round(share * SWEEPS / SEGMENT / 3))
    segment = np.minimum((time / SEGMENT).astype(int), len(active) - 1)
    for index, wire in enumerate(active):
        inside = segment == index
        phase = (time[inside] - index * SEGMENT) / SEGMENT
        level = rng.choice(LEVELS, 3) * TENSION_MAX
        level[(wire + rng.integers(1, 3)) % 3] *= rng.random() < 0.5
        top = rng.uniform(0.3, 0.7)
        reference[inside] = level
        reference[inside, wire] = TENSION_MAX[wire] * np.minimum(phase / top, (1 - phase) / (1 - top))
    return Protocol("sweeps", np.maximum(reference, TENSION_MIN))


def chirp(rng: np.random.Generator, share: float = 1.0) -> Protocol:
    """Chirp: each wire in turn swings between 10 and 80 % of its maximum, from about 0.1 to about 1.8 Hz.

    The other wires rest at a base level.
    """
    time = clock(share * CHIRP)
    span = share * CHIRP / 3
    reference = np.tile(TENSION_MAX * rng.uniform(0.1, 0.2, 3), (len(time), 1))
    for index, wire in enumerate(rng.permutation(3)):
        inside = (time >= index * span) & (time < (index + 1) * span)
        local = time[inside] - index * span
        low, high = rng.uniform(0.04, 0.15), rng.uniform(1.4, 2.0)
        phase = 2 * np.pi * (low * local + (high - low) * local**2 / (2 * span))
        reference[inside, wire] = TENSION_MAX[wire] * (0.45 - 0.35 * np.cos(phase))
    return Protocol("chirp", reference)


def holds(rng: np.random.Generator, share: float = 1.0) -> Protocol:
    """Steps to random levels of all wires, held 6 to 10 s."""
    time = clock(share * HOLDS)
    edges = np.arange(HOLD, share * HOLDS, HOLD)
    edges = np.sort(edges + rng.uniform(-1, 1, len(edges)))
    levels = rng.uniform(0.1, 0.9, (len(edges) + 1, 3)) * TENSION_MAX
    return Protocol("holds", levels[np.searchsorted(edges, time, side="right")])


def smooth(x: np.ndarray) -> np.ndarray:
    """Minimum-jerk step from 0 to 1 of a phase (n,) [-]."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def grasps(rng: np.random.Generator, share: float = 1.0) -> Protocol:
    """Smooth grips of random synergy, depth, pace and hold."""
    time = clock(share * GRASPS)
    reference = np.full((len(time), 3), TENSION_MIN)
    patterns = np.array([[1.0, 0.25, 0.55], [1.0, 0.03, 0.04], [0.05, 1.0, 0.04], [0.7, 0.6, 0.1], [0.3, 0.1, 0.9]])
    start = rng.uniform(0, 1)
    while start < share * GRASPS:
        close, hold, pause = rng.uniform(0.5, 1.6), rng.uniform(0.8, 2.5), rng.uniform(0.3, 1.5)
        peak = patterns[rng.integers(len(patterns))] * rng.uniform(0.5, 0.9) * TENSION_MAX
        bump = smooth((time - start) / close) * smooth((start + 2 * close + hold - time) / close)
        reference += bump[:, None] * np.maximum(0.0, peak - TENSION_MIN)
        start += 2 * close + hold + pause
    return Protocol("grasps", reference)


def wander(rng: np.random.Generator, share: float = 1.0) -> Protocol:
    """Smooth random motion of all wires at once: sums of slow sines through a soft limiter."""
    time = clock(share * GRASPS)
    reference = np.empty((len(time), 3))
    for wire in range(3):
        frequency = rng.uniform(0.03, 0.9, 7)
        weight = rng.standard_normal(7) / (0.3 + frequency)
        course = (weight * np.sin(2 * np.pi * np.outer(time, frequency) + rng.uniform(0, 2 * np.pi, 7))).sum(axis=1)
        level = 1 / (1 + np.exp(-1.5 * course / course.std() - rng.uniform(-1.5, 0.5)))
        reference[:, wire] = TENSION_MIN + level * (0.9 * TENSION_MAX[wire] - TENSION_MIN)
    return Protocol("grasps", reference)


def protocols_of(rng: np.random.Generator, unseen: bool, share: float = 1.0) -> dict[str, Protocol]:
    """Motions of one case by log name.

    Args:
        rng: Random generator.
        unseen: Whether the held-out log is the random smooth motion.
        share: Duration relative to the usual one.

    Returns:
        Log name -> motion.
    """
    sweep = sweeps(rng, share)
    return {
        "sweeps_1": sweep,
        "sweeps_2": sweep,
        "chirp": chirp(rng, share),
        "holds": holds(rng, share),
        "grasps": (wander if unseen else grasps)(rng, share),
    }
