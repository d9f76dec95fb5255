"""Wire between spool and finger: elastic, one-sided, and the places where friction, creep and slack act.

    T_c = max(0, k (s - l))        tension of the wire before its sheath, s = 0 just taut at q = 0
    T_d = T_c                      tension at the finger, nominally
    T_c                            tension at the load cell and at the spool, nominally

Sheath friction needs to know where in its travel the wire slides: `slide` is the wire's displacement since the last
reversal, clipped to +-presliding, over presliding: -1 .. 1, +1 while the finger takes wire in. A wire that goes slack
lets go of its sheath: slide is then kept within `grip`.
"""

import sys

from exodrake.model.part import TENDONS, FreeLaw, Point, free_memory

HERE = sys.modules[__name__]
TAUT = 0.1  # tension above which the wire lies against its sheath [N]; assumed
GRIP = "-min(1.0, tension / 0.1)"  # friction fades as the wire goes slack (`grip`)

stretch = Point(
    "stretch", TENDONS, "extension, tension_finger", "elastic stretch of the wire [m], from s - l [m]", module=HERE,
    laws=(
        FreeLaw("lengthening over tension", "tension_finger", "N", "-1.0"),
        *free_memory("of length over tension", "tension", "N", "settle"),
    ),
)  # fmt: skip
elastic = Point(
    "elastic", TENDONS, "tension, stretch, stiffness", "tension [N] of the stretched wire, from k stretch [N]",
    module=HERE, laws=(
        FreeLaw("tension over stretch", "stretch", "m"),
        *free_memory("of tension", "stretched", "m", "settle"),
    ),
)  # fmt: skip
near_end = Point(
    "near_end", TENDONS, "tension, stretched, travel",
    "tension [N] at the cell's end of the sheath, from that of the whole wire; stretched [m]; travel: of the finger's "
    "end in this tick [m]", (), HERE,
)  # fmt: skip
far_end = Point(
    "far_end", TENDONS, "tension, stretched, travel",
    "tension [N] at the finger's end of the sheath, from that at the cell's end; as in `near_end`", (), HERE,
)  # fmt: skip
transmit = Point(
    "transmit", TENDONS, "tension, slide, travel, speed",
    "tension at the finger [N] from the one at the load cell; slide: state of the presliding friction [-1 .. 1]; "
    "travel: in this tick [m]; speed: [m/s], > 0 while the finger takes wire in", module=HERE,
    laws=(
        FreeLaw("friction over tension", "tension", "N", "-slide"),
        FreeLaw("friction over speed", "speed", "m/s", GRIP, fine=True),
        *free_memory("of friction over travel", "travel", "m", "settle", GRIP, moves=True),
    ),
)  # fmt: skip
at_cell = Point("at_cell", TENDONS, "tension", "load on the cell [N], from that of the wire", (), HERE)
at_spool = Point("at_spool", TENDONS, "tension", "tension at the spool [N], from that of the wire", (), HERE)
settle = Point(
    "settle", TENDONS, "dt, stretched, tension, tension_finger, travel",
    "states of the effects on the wire after dt [s]; stretched, travel [m]; tensions [N]", (), HERE,
)  # fmt: skip


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
