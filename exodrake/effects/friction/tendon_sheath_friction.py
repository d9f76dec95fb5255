"""Sheath friction spread along an elastic wire, between cell and finger (capstan law in every bend of the sheath).

    T_(i+1) / T_i within exp(-a) .. exp(+a)        a = mu_phi / 4          T_i = 5 k e_i          sum e_i = stretch

Five pieces of wire in series, four bends between them. A bend holds the wire while the ratio of the tensions beside it
lies inside the cone; else it lets the wire slip until the ratio is at the edge. So a motion of either end reaches only
as far as it must: a spool that reverses against a finger that does not move shows hysteresis, and the finger keeps its
tension for a while. Quasi-static and rate-free; each end of the wire is moved in turn and solved exactly. In full slip
T_finger = T_cell exp(-mu_phi), as in `tendon.capstan_friction`.
"""

from math import exp

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS

PIECES, BENDS = 5, 4.0


def slipping(first, ratio, count):
    """First of `count` stretches [m] in a row, each `ratio` times the one before, that add up to `first`."""
    total, one = 0.0, 1.0
    for _ in range(count):
        total, one = total + one, one * ratio
    return first / total


def held(nearer, farther, ratio):
    """Whether a bend holds between the stretches of the moving and of the next piece [m]; ratio: of a slip there."""
    return farther >= ratio * nearer if ratio < 1.0 else farther <= ratio * nearer


def moved(own, change, cone):
    """Stretches [m] of the pieces, in order from the end that moves, after it moved by `change` [m] (> 0 stretches)."""
    ratio = cone if change > 0.0 else 1.0 / cone
    first, count, sum_slipping = own[0] + change, 1, own[0] + change
    while count < PIECES:
        last = first * ratio ** (count - 1.0)
        if held(last, own[count], ratio):
            break
        sum_slipping += own[count]
        count += 1
        first = max(0.0, slipping(sum_slipping, ratio, count))
    return (
        max(0.0, first),
        piece(1, own, first, ratio, count),
        piece(2, own, first, ratio, count),
        piece(3, own, first, ratio, count),
        piece(4, own, first, ratio, count),
    )


def piece(i, own, first, ratio, count):
    """Stretch [m] of piece i where the first `count` of them slip."""
    return max(0.0, first) * ratio**i if i < count else own[i]


def turned(own):
    """Pieces in reverse order."""
    return own[4], own[3], own[2], own[1], own[0]


def drawn(stretched, travel, mu_phi, e1, e2, e3, e4, e5):
    """Stretches [m] of the pieces from cell to finger, after finger's and spool's end have moved.

    The finger's end goes first where it stretches the wire (travel < 0), so that the wire never runs slack between.
    """
    cone, own = exp(-mu_phi / BENDS), (e1, e2, e3, e4, e5)
    change = stretched + travel - (e1 + e2 + e3 + e4 + e5)
    if travel < 0.0:
        return moved(turned(moved(turned(own), -travel, cone)), change, cone)
    return turned(moved(turned(moved(own, change, cone)), -travel, cone))


def near_end(tension, stretched, travel, mu_phi, e1, e2, e3, e4, e5):
    """Tension at the cell's end [N], from that of a wire that is stretched alike all along."""
    if stretched <= 0.0:
        return tension
    return tension * PIECES * drawn(stretched, travel, mu_phi, e1, e2, e3, e4, e5)[0] / stretched


def far_end(tension, stretched, travel, mu_phi, e1, e2, e3, e4, e5):
    """Tension at the finger's end [N], from that at the cell's end."""
    pieces = drawn(stretched, travel, mu_phi, e1, e2, e3, e4, e5)
    return tension * pieces[4] / pieces[0] if pieces[0] > 0.0 else tension


def settle(dt, stretched, tension, tension_finger, travel, mu_phi, e1, e2, e3, e4, e5):
    """Stretches of the pieces [m]."""
    return drawn(stretched, travel, mu_phi, e1, e2, e3, e4, e5)


EFFECT = Effect(
    id="tendon.sheath_friction",
    summary="sheath friction spread along an elastic wire",
    signature="as capstan friction, and loops of tension against stroke at a finger held still",
    source="Kaneko et al., IEEE T-RA 7(3), 1991; Agrawal et al., IEEE T-RO 26(6), 2010",
    at={"tendon.near_end": near_end, "tendon.far_end": far_end, "tendon.settle": settle},
    parameters=(EffectParameter("mu_phi", "-", null=0.0, low=0.05, high=0.9, axis=TENDONS, default=0.3),),
    states=(State("stretches", TENDONS, PIECES, "m"),),
    advances=("tendon.settle",),
    family="friction",
    not_tried="another law of tendon.capstan_friction, which is tried",
    order=228,
)
