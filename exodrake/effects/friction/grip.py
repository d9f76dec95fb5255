"""Friction that does not depend on load still needs a taut wire: it fades as the wire goes slack.

The fading makes the tension at the finger a continuous function of stretch, which the plant's Newton steps need. What a
bristle stores is let go as its wire goes slack and must be wound up again: its deflection is kept within the grip.
"""

from exodrake.physics.tendon import grip


def gripped(friction, tension):
    """Friction force [N] on a wire under this tension [N]."""
    return friction * grip(tension)


def kept(bristle, tension):
    """Bristle [-1 .. 1], no further bent than a wire under this tension [N] can hold it."""
    most = grip(tension)
    return min(max(bristle, -most), most)
