"""Friction that does not depend on load still needs a taut wire: it fades as the wire goes slack.

The fading makes the tension at the finger a continuous function of stretch, which the plant's Newton steps need.
"""

TAUT = 0.1  # tension above which the wire lies against its sheath [N]; assumed


def gripped(friction, tension):
    """Friction force [N] on a wire under this tension [N]."""
    return friction * min(1.0, tension / TAUT)
