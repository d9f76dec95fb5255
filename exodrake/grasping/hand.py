"""The thumb and the three grasp modes: the geometry of a grasp, before the tendons come in.

The splint holds the thumb (paper, Section 2.1), but the paper does not say where: place and pad below are assumed, so
that the nominal finger, which the tendons bend by some 0.7 rad at the MCP, meets objects of 20 to 90 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.physics.tendon_finger import Parameters

FREE = 9.0  # rad, no limit


@dataclass(frozen=True)
class Hand:
    """The thumb in the finger's plane, and how soft skin is.

    Attributes (all assumed):
        thumb: centre of its round tip (x, y palmar) [m].
        thumb_radius: of the tip [m].
        pad: where the distal phalanx touches in a pinch, as a fraction of its length.
        soft: how deep an object sinks into a pad [m].
        tissue: how far joints go beyond the onset of their end stops [rad].
    """

    thumb: tuple[float, float] = (0.030, 0.090)
    thumb_radius: float = 0.009
    pad: float = 0.75
    soft: float = 0.0025
    tissue: float = 0.15

    def limits(self, n: Parameters) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest joint angles (3,), (3,) [rad]."""
        return np.array(n.q_e) - self.tissue, np.array(n.q_f) + self.tissue


@dataclass(frozen=True)
class Mode:
    """A way to grasp.

    Attributes:
        name: of the mode.
        low, high: joint angles less the rest posture [rad].
        weight: cost of each joint's departure from rest.
        wraps: whether all phalanges touch the object, or the distal one alone.
    """

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    weight: tuple[float, float, float]
    wraps: bool = False


# Paper, Section 2.2.2: "wide pinch, which only bends the PIP joint", narrow pinch by MCP flexion, caging by all joints.
# The others stay within STILL of rest, in flexion and in extension.
STILL = 0.1  # rad, assumed
NARROW = Mode("narrow-pinch", (-FREE, -STILL, -STILL), (FREE, STILL, STILL), (0.0, 1.0, 1.0))
WIDE = Mode("wide-pinch", (-STILL, 0.0, -STILL), (STILL, FREE, STILL), (1.0, 0.0, 1.0))
CAGING = Mode("caging", (-FREE, -FREE, -FREE), (FREE, FREE, FREE), (0.0, 0.0, 0.0), wraps=True)
MODES = {mode.name: mode for mode in (CAGING, NARROW, WIDE)}


def mode_of(name: str) -> Mode:
    """The mode of that name, spaces or underscores allowed; InputError with the nearest one otherwise."""
    plain = "-".join(name.lower().replace("_", " ").replace("-", " ").split())
    if plain not in MODES:
        raise InputError(f"unknown grasp mode {name!r}{nearest(plain, list(MODES))}; there are {', '.join(MODES)}")
    return MODES[plain]


def check_size(size: float, hand: Hand, n: Parameters) -> float:
    """The size of an object [m]. InputError if it is not a length, or wider than finger and thumb can span."""
    span = abs(complex(*hand.thumb)) + sum(n.length) - hand.thumb_radius - n.radius[2]
    number = isinstance(size, (int, float, np.number)) and not isinstance(size, bool)
    if not number or not isfinite(size) or not 0.0 < size <= span:
        shown = f"{size:g} m" if number else repr(size)
        raise InputError(
            f"object size is {shown}, wanted more than 0 and at most {span:.3f} m: finger and thumb span that"
        )
    return float(size)
