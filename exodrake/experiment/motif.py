"""Motifs: short motions from rest to rest with a few parameters each, from which an experiment is composed.

In a motif every channel goes to a level, swings about it, and comes back:

    u(t) = u0 + e(t) (level + swing sin(2 pi phi(t) + phase) - u0)         phi' from f_first to f_last

The envelope e rises and falls within a share of the motif: a short share gives a step and a hold, a long one a ramp.
With a swing the motif is a sine, a chirp, or a triangle of constant speed. u is a share of the span between the lowest
and the highest reference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from exodrake.simulation.tensions import smooth

HEADROOM = 0.05  # of the span, between a level and either end, which a swing may reach: assumed
CYCLES = 0.5, 12.0  # of a swing in a motif, at least and at most, so that each is seen: assumed
FASTEST = 8.0  # frames in the shortest period: two samples an edge
STEADY = 0.25  # probability that a channel of a random motif does not swing: assumed
BLEND = 0.1  # share of a window at either end that leads from and to rest: assumed
STEP = 0.15  # standard deviation of a mutation of a parameter in 0 .. 1: assumed
CHANGED = 0.3  # probability that a mutation touches a parameter: assumed


@dataclass(frozen=True, eq=False)
class Motif:
    """A motion by parameters in 0 .. 1.

    Attributes:
        channels: (3, channels) level, swing and phase of each.
        common: (4,) first and last frequency, how long rise and fall take, and above a half triangles for sines.
    """

    channels: np.ndarray
    common: np.ndarray

    def shares(self, frames: int, rest: np.ndarray) -> np.ndarray:
        """Shares (frames, channels) of the span; rest: (channels,) where it begins and ends."""
        level, swing, phase = self.channels
        u = HEADROOM + (1.0 - 2.0 * HEADROOM) * level
        room = swing * np.minimum(u, 1.0 - u)
        most = min(CYCLES[1], frames / FASTEST)
        first, last = CYCLES[0] * (most / CYCLES[0]) ** self.common[:2]
        s = np.linspace(0.0, 1.0, frames)
        turns = first * s + 0.5 * (last - first) * s**2
        rise = 0.5 * max(float(self.common[2]) ** 2, 2.0 / frames)
        envelope = smooth(s / rise) * smooth((1.0 - s) / rise)
        wave = np.sin(2.0 * np.pi * (turns[:, None] + phase))
        wave = np.arcsin(wave) / (0.5 * np.pi) if self.common[3] > 0.5 else wave
        return rest + envelope[:, None] * (u + room * wave - rest)

    def mutated(self, rng: np.random.Generator) -> Motif:
        """The motif with some parameters moved."""

        def moved(values: np.ndarray) -> np.ndarray:
            change = STEP * rng.standard_normal(values.shape) * (rng.random(values.shape) < CHANGED)
            return np.clip(values + change, 0.0, 1.0)

        return replace(self, channels=moved(self.channels), common=moved(self.common))


@dataclass(frozen=True, eq=False)
class Window:
    """A piece of a known motion, `course` (frames, channels) in shares of the span, led from and to rest."""

    course: np.ndarray

    def shares(self, frames: int, rest: np.ndarray) -> np.ndarray:
        """Shares (frames, channels) of the span; rest: (channels,) where it begins and ends."""
        at = np.linspace(0.0, len(self.course) - 1.0, frames).round().astype(int)
        s = np.linspace(0.0, 1.0, frames)
        envelope = smooth(s / BLEND) * smooth((1.0 - s) / BLEND)
        return rest + envelope[:, None] * (self.course[at] - rest)

    def mutated(self, rng: np.random.Generator) -> Motif:
        """A random motif that replaces the window."""
        return random_motif(self.course.shape[1], rng)


def random_motif(channels: int, rng: np.random.Generator) -> Motif:
    """A motif of that many channels with parameters drawn evenly; some channels do not swing."""
    values = rng.random((3, channels))
    values[1] *= rng.random(channels) >= STEADY
    return Motif(values, rng.random(4))
