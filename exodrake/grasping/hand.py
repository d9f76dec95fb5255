"""The thumb, the three grasp modes, and the postures that hold a round object of radius R, in closed form.

The splint holds the thumb (paper, Section 2.1), but the paper does not say where: place and pad are assumed, so that
the nominal finger, which the tendons bend by some 0.7 rad at the MCP, meets objects of 20 to 90 mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.physics.tendon_finger import Parameters

FREE = 9.0  # rad, no limit
GRID = 81  # points along each free direction
OFF = 0.9  # rad, how far a cage may stay off the thumb
DEPTH = 0.02  # m of penetration or of an open cage that count like 1 rad beyond a limit
REACH = 1.2  # rad beyond rest that the PIP bends at most in a pinch


@dataclass(frozen=True)
class Hand:
    """The thumb in the finger's plane, and how soft skin is; all values are assumed."""

    thumb: tuple[float, float] = (0.030, 0.090)  # centre of its round tip (x, y palmar) [m]
    thumb_radius: float = 0.009  # of the tip [m]
    pad: float = 0.75  # where the distal phalanx touches in a pinch, as a fraction of its length
    soft: float = 0.0025  # how deep an object sinks into a pad [m]
    tissue: float = 0.15  # how far joints go beyond the onset of their end stops [rad]


@dataclass(frozen=True)
class Mode:
    """A way to grasp, with limits of the joint angles less the rest posture [rad].

    `weight` is the cost of each joint's departure from rest; `wraps` whether all phalanges touch, or the distal alone.
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


def find_mode(name: str) -> Mode:
    """The mode of that name, spaces or underscores allowed; InputError with the nearest one otherwise."""
    plain = "-".join(name.lower().replace("_", " ").replace("-", " ").split())
    if plain not in MODES:
        raise InputError(f"unknown grasp mode {name!r}{nearest(plain, list(MODES))}; there are {', '.join(MODES)}")
    return MODES[plain]


def check_size(size: float, hand: Hand, n: Parameters) -> float:
    """The size of an object [m]. InputError if it is not a length, or wider than finger and thumb can span."""
    span = abs(complex(*hand.thumb)) + sum(n.length) - hand.thumb_radius - n.radius[2]
    number = isinstance(size, (int, float, np.number)) and not isinstance(size, bool)
    if not (number and 0.0 < size <= span):
        wanted = f"wanted more than 0 and at most {span:.3f} m: finger and thumb span that"
        raise InputError(f"object size is {f'{size:g} m' if number else repr(size)}, {wanted}")
    return float(size)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Postures (k, 3) [rad] that touch the object, its complex centre (k,) [m], and its gap (k,) to the thumb [m].

    `miss` (k,) is by how much a posture violates limits of joints or mode, penetrates a phalanx or lets the object out
    [rad, or m / DEPTH]; 0 for an admissible one.
    """

    angles: np.ndarray
    centre: np.ndarray
    gap: np.ndarray
    miss: np.ndarray


def candidates(mode: Mode, size: float, hand: Hand, n: Parameters) -> Candidates:
    """All postures of a mode about an object of a size [m], admissible (miss = 0) or not.

    The contacts fix the object's centre C in a frame of the straight proximal phalanx. In a pinch the pad touches at s
    along the distal phalanx; in a cage all phalanges do (`wrap_postures`). The MCP then turns C against the thumb's tip
    T of radius r_T by the law of cosines, in front of it. What is left free is a grid.

        C = L1 + L2 e^{i q2} + (s + i (R + r3)) e^{i (q2 + q3)}
        q1 = arg T - acos((|C|^2 + |T|^2 - (R + r_T)^2) / (2 |C| |T|)) - arg C
    """
    radius, thumb = size / 2.0, complex(*hand.thumb)
    low, high = bounds(mode, hand, n)
    if mode.wraps:
        bend, held, off = wrap_postures(radius, n)
    else:  # the pad touches, whatever PIP and DIP
        spans = [np.linspace(low[i], min(high[i], n.q0[i] + REACH), GRID) for i in (1, 2)]
        pip, dip = (axis.ravel() for axis in np.meshgrid(*spans))
        pad = hand.pad * n.length[2] + 1j * (radius + n.radius[2])
        held = n.length[0] + n.length[1] * np.exp(1j * pip) + pad * np.exp(1j * (pip + dip))
        bend, off = np.column_stack([pip, dip]), np.zeros(len(pip))
    touch = radius + hand.thumb_radius
    cosine = (np.abs(held) ** 2 + abs(thumb) ** 2 - touch**2) / (2.0 * np.abs(held) * abs(thumb))
    beyond = np.maximum(np.abs(cosine) - 1.0, 0.0)
    mcp = np.angle(thumb) - np.arccos(np.clip(cosine, -1.0, 1.0)) - np.angle(held) - off
    angles = np.column_stack([mcp, bend])
    centre = held * np.exp(1j * mcp)
    gap = np.abs(centre - thumb) - touch
    miss = np.maximum(np.maximum(low - angles, angles - high), 0.0).sum(axis=1)
    ends, pierced = joints(angles, n), np.zeros(len(angles))  # m, by which the object enters a phalanx
    for i in range(3):
        bone = ends[:, i + 1] - ends[:, i]
        along = (centre - ends[:, i]) * bone.conj() / np.abs(bone)
        away = np.abs(along - np.clip(along.real, 0.0, np.abs(bone)))
        pierced = np.maximum(pierced, radius + n.radius[i] - away)
    miss += np.maximum(pierced - hand.soft, 0.0) / DEPTH
    if mode.wraps:
        opening = np.abs(ends[:, 3] - thumb) - n.radius[2] - hand.thumb_radius  # m, between fingertip and thumb
        miss += np.where(cosine < 0.0, beyond, 0.0) + np.maximum(opening - size, 0.0) / DEPTH
    else:
        miss += beyond
    return Candidates(angles, centre, gap, miss)


def bounds(mode: Mode, hand: Hand, n: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest joint angles (3,) [rad] of a mode."""
    rest = np.array(n.q0)
    low, high = np.array(n.q_e) - hand.tissue, np.array(n.q_f) + hand.tissue
    return np.maximum(low, rest + mode.low), np.minimum(high, rest + mode.high)


def wrap_postures(radius: float, n: Parameters) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """PIP and DIP (k, 2) [rad], centre (k,) [m] and how far off the thumb (k,) [rad], all phalanges tangent.

    With contact at s along the middle phalanx and rho_i = R + r_i: h^2 = s^2 + rho_2^2, h'^2 = (L2 - s)^2 + rho_2^2,

        q2 = pi - atan2(rho_2, s) - asin(rho_1 / h)        q3 = pi - atan2(rho_2, L2 - s) - asin(rho_3 / h')
    """
    first, second, third = radius + np.array(n.radius)
    shortest = np.sqrt(max(first**2 - second**2, 0.0))
    along = np.linspace(min(shortest, n.length[1]), n.length[1], 2 * GRID)
    far = np.maximum(np.hypot(along, second), first)
    rest = n.length[1] - along
    beyond = np.maximum(np.hypot(rest, second), third)
    pip = np.pi - np.arctan2(second, along) - np.arcsin(first / far)
    dip = np.pi - np.arctan2(second, rest) - np.arcsin(third / beyond)
    near, end = np.sqrt(far**2 - first**2), np.sqrt(beyond**2 - third**2)
    on = (near <= n.length[0]) & (end <= n.length[2])
    on = on if on.any() else np.ones_like(on)
    held, bend = n.length[0] - near[on] + 1j * first, np.column_stack([pip, dip])[on]
    off = np.linspace(0.0, OFF, GRID // 2)
    return np.repeat(bend, len(off), axis=0), np.repeat(held, len(off)), np.tile(off, len(bend))


def joints(angles: np.ndarray, n: Parameters) -> np.ndarray:
    """MCP, PIP, DIP and fingertip (..., 4) complex [m]; angles (..., 3) [rad]."""
    bones = np.array(n.length) * np.exp(1j * np.cumsum(angles, axis=-1))
    return np.concatenate([np.zeros_like(bones[..., :1]), np.cumsum(bones, axis=-1)], axis=-1)
