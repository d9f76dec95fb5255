"""Friction that grows with load: a spring that slips at a limit (Jenkins element with a varying normal load).

    dF = stiffness dx          low <= F <= high          the limits follow the load, the stiffness does not

The energy F^2 / (2 stiffness) that the spring stores does not depend on the load: where the load falls at standstill
the spring slips and loses energy, where it rises the force stays. A bristle in -1 .. 1 times the load would be given
energy by every rise of the load, and a cycle of load and motion could take it out. Yang, Chu, Menq, J. Sound Vib.
210(4), 1998 (friction contacts under variable normal load).
"""

LOAD = 4.0  # tension at which a presliding travel is stated [N]: in the middle of the wires' ranges


def spring(friction, presliding):
    """Stiffness [N/m] of friction of `friction` times the load that builds up over `presliding` [m] at LOAD."""
    return friction * LOAD / presliding


def yielded(force, travel, stiffness, low, high):
    """Force [N] after a further travel [m]; low <= 0 <= high: the limits of the present load [N]."""
    return min(max(force + stiffness * travel, low), high)
