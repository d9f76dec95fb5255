"""The LuGre law (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE T-AC 40(3), 1995), a step at a time.

    z' = v - sigma_0 |v| z / g(v)          g(v) of `friction.stribeck`
    F = sigma_0 z + sigma_1 z' + sigma_2 v

The bristle is exact for a speed held over the step; z' is its mean over the step.
"""

from math import exp


def deflected(z, travel, steady, stiffness):
    """Deflection of the bristle [m] after a travel [m]; steady: g(v) [N]; stiffness: sigma_0 [N/m]."""
    end = steady / stiffness if travel > 0.0 else -steady / stiffness
    return end + (z - end) * exp(-abs(travel) * stiffness / steady)


def force(z, after, travel, speed, stiffness, damping):
    """F [N] without its part sigma_2 v, as the deflection went from z to `after` [m]; damping: sigma_1 [N s/m]."""
    rate = speed * (after - z) / travel if travel != 0.0 else 0.0
    return stiffness * after + damping * rate
