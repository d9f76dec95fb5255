"""First-order relaxation, exact for a target held over the tick."""

from math import exp


def relaxed(state, target, dt, time_constant):
    """State after dt [s] on its way to the target."""
    return target + (state - target) * exp(-dt / time_constant)
