"""Wire between spool and finger: elastic, one-sided, and the places where friction, creep and slack act.

    T_c = max(0, k (s - l))        tension at the cell, s = 0 just taut at q = 0
    T_d = T_c                      tension at the finger, nominally

Sheath friction needs to know where in its travel the wire slides: `slide` is the wire's displacement since the last
reversal, clipped to +-presliding, over presliding: -1 .. 1, +1 while the finger takes wire in.
"""


def stretch(e, z, j, extension, tension_finger):
    """Point: elastic stretch of the wire [m], from s - l [m]."""
    return extension


def elastic(e, z, j, tension, stretch, stiffness):
    """Point: tension [N] of the stretched wire, from k stretch [N]."""
    return tension


def transmit(e, z, j, tension, slide, travel, speed):
    """Point: tension at the finger [N] from the one at the load cell.

    slide: state of the presliding friction [-1 .. 1]; travel: in this tick [m]; speed: [m/s], > 0 while the finger
    takes wire in.
    """
    return tension


def settle(e, z, j, dt, stretched, tension, tension_finger, travel):
    """Point: after a tick, states of the effects on the wire advance by dt [s]; stretched, travel [m], tensions [N]."""


def stretched_by(e, z, j, extension, tension_finger):
    """Stretch of the wire, 0 or more [m], for s - l = extension [m]; tension_finger [N] is that of the tick before."""
    return max(0.0, stretch(e, z, j, extension, tension_finger))


def cell_tension(e, z, j, stretched, k):
    """Tension at the cell [N] of a wire stretched by 0 or more [m]."""
    return max(0.0, elastic(e, z, j, k * stretched, stretched, k))


def slid(slide, travel, presliding):
    """Slide [-1 .. 1] after the finger took in `travel` more wire [m]."""
    return min(max(slide + travel / presliding, -1.0), 1.0)


def finger_tension(e, z, j, tension, slide, travel, speed):
    """Tension at the finger [N], from the one at the cell [N]."""
    return max(0.0, transmit(e, z, j, tension, slide, travel, speed)) if tension > 0.0 else 0.0
