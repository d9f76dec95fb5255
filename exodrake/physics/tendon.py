"""Wire between spool and finger: elastic, one-sided, and the places where friction, creep and slack act.

    T_c = max(0, k (s - l))        tension of the wire before its sheath, s = 0 just taut at q = 0
    T_d = T_c                      tension at the finger, nominally
    T_c                            tension at the load cell and at the spool, nominally

Sheath friction needs to know where in its travel the wire slides: `slide` is the wire's displacement since the last
reversal, clipped to +-presliding, over presliding: -1 .. 1, +1 while the finger takes wire in. A wire that goes slack
lets go of its sheath: slide is then kept within `grip`.
"""

TAUT = 0.1  # tension above which the wire lies against its sheath [N]; assumed


def stretch(e, z, j, extension, tension_finger):
    """Point: elastic stretch of the wire [m], from s - l [m]."""
    return extension


def elastic(e, z, j, tension, stretch, stiffness):
    """Point: tension [N] of the stretched wire, from k stretch [N]."""
    return tension


def near_end(e, z, j, tension, stretched, travel):
    """Point: tension [N] at the cell's end of the sheath, from that of the whole wire.

    stretched: [m]; travel: of the finger's end in this tick [m].
    """
    return tension


def far_end(e, z, j, tension, stretched, travel):
    """Point: tension [N] at the finger's end of the sheath, from that at the cell's end; as in `near_end`."""
    return tension


def at_cell(e, z, j, tension):
    """Point: load on the cell, as tension [N], from that of the wire before its sheath."""
    return tension


def at_spool(e, z, j, tension):
    """Point: tension at the spool [N], from that of the wire before its sheath."""
    return tension


def transmit(e, z, j, tension, slide, travel, speed):
    """Point: tension at the finger [N] from the one at the load cell.

    slide: state of the presliding friction [-1 .. 1]; travel: in this tick [m]; speed: [m/s], > 0 while the finger
    takes wire in.
    """
    return tension


def settle(e, z, j, dt, stretched, tension, tension_finger, travel):
    """Point: after a tick, states of the effects on the wire advance by dt [s]; stretched, travel [m], tensions [N]."""


def stretch_wire(e, z, j, extension, tension_finger):
    """Stretch of the wire, 0 or more [m], for s - l = extension [m]; tension_finger [N] is that of the tick before."""
    return max(0.0, stretch(e, z, j, extension, tension_finger))


def cell_tension(e, z, j, stretched, travel, k):
    """Tension [N] before the sheath of a wire stretched by 0 or more [m]; travel in this tick [m]."""
    whole = max(0.0, elastic(e, z, j, k * stretched, stretched, k))
    return near_end(e, z, j, whole, stretched, travel)


def grip(tension):
    """Share of its dry friction [0 .. 1] that a wire under this tension [N] has against its sheath."""
    return min(1.0, tension / TAUT)


def move_slide(slide, travel, presliding, tension):
    """Slide [-1 .. 1] after the finger took in `travel` more wire [m]; tension at the cell's end, 0 or more [N]."""
    most = grip(tension)
    return min(max(slide + travel / presliding, -most), most)


def finger_tension(e, z, j, tension, stretched, slide, travel, speed):
    """Tension at the finger [N], from the one before the sheath [N]."""
    if tension <= 0.0:
        return 0.0
    return max(0.0, transmit(e, z, j, far_end(e, z, j, tension, stretched, travel), slide, travel, speed))
