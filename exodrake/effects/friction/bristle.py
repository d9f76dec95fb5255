"""A bristle: what stands between two rubbing surfaces and turns round over a width of travel (Dahl's law, exact).

    dz/dx = (1 - z sgn(x')) / width          z -> +1 in forward travel, -1 in backward travel

Rate-free, never beyond 1, and dissipative in every closed loop.
"""

from math import exp


def bent(bristle, travel, width):
    """Bristle [-1 .. 1] after a further travel [same unit as width]."""
    end = 1.0 if travel > 0.0 else -1.0
    return end + (bristle - end) * exp(-abs(travel) / width)


def clipped(bristle, travel, width):
    """The same with a straight rise: stiff up to the end, then sliding [-1 .. 1]."""
    return min(max(bristle + travel / width, -1.0), 1.0)
