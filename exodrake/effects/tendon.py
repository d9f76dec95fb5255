"""Tendon: what its wire is beyond a linear spring, and its friction in the sheath between cell and finger.

Friction that does not depend on load still needs a taut wire: it fades as the wire goes slack (`grip`). The fading
makes the tension at the finger a continuous function of stretch, which the plant's Newton steps need. What a bristle
stores is let go as its wire goes slack and must be wound up again: `limit_to_grip` keeps its deflection.
"""

from math import exp, expm1, inf

from exodrake.effects.friction import bend_bristle, deflect_bristle, find_stiffness, level, slip_spring, turn_bristle
from exodrake.effects.signal import relax
from exodrake.model.effect import ANY_SHAPE, Effect, per_tendon
from exodrake.model.part import TENDONS, State
from exodrake.physics.tendon import grip

LIMIT = 3.0  # exponent from which a stiffening wire's curve is straight [-]
FADES = 4.0  # stiffening fades once k / soft - 1 is below 1 / FADES [-]: assumed
PRESLIDING = 5e-5  # travel over which the friction turns round at `friction.LOAD` [m]; assumed, as tendon.presliding
MEMORY = 4e-3  # time constant of the frictional memory [s]; assumed
PIECES, BENDS = 5, 4.0  # of the wire in its sheath
STOPS = 3.0


def take_up_slack(extension, length, toe):
    """Elastic stretch [m] of a wire longer than assumed, which comes taut over a toe; what is left of it below 0.

        x = s - l - length          stretch = max(0, x)                   |x| > toe / 2
                                            = (x + toe / 2)^2 / (2 toe)   within the toe

    The strands of a braid straighten and its anchor settles before all of it pulls: the stretch sets in before `length`
    is taken in, and half a toe beyond it is that of a straight line from there. A toe is no longer than the slack.
    """
    beyond, half = extension - length, 0.5 * min(toe, length)
    if beyond >= half:
        return beyond
    if beyond <= -half:
        return beyond + half
    return 0.25 * (beyond + half) * (beyond + half) / half


def subtract_creep(extension, stiffness, time_constant, elongation):
    """Stretch [m] of a standard linear solid: T_c = k (s - l - y); time_constant y' = T_c / stiffness - y."""
    return extension - elongation


def settle_creep(dt, tension, stiffness, time_constant, elongation):
    """Delayed elongation [m]."""
    return relax(elongation, tension / stiffness, dt, time_constant)


def stiffen_wire(tension, stretch, stiffness, soft_stiffness, stiffening):
    """Tension [N] of a wire that stiffens as it is stretched (toe region of a braid).

        T_c = soft / grows (exp(grows x) - 1)          x = s - l          tangent stiffness soft + grows T_c

    The toe is softer than the wire: `grows` is `stiffening` for a soft stiffness of up to 0.8 k and fades to 0 as that
    comes to k, from where the wire is k x; else a wire that is hardly affected would be stiffer than steel. Beyond an
    exponent of LIMIT the curve goes on straight.
    """
    grows = stiffening * min(1.0, FADES * (stiffness / soft_stiffness - 1.0))
    if grows <= 0.0:
        return tension
    power = min(grows * stretch, LIMIT)
    curved = expm1(power)
    return soft_stiffness / grows * (curved + (1.0 + curved) * (grows * stretch - power))


def plastic(z, change, width):
    """Z [m] after a further change of stretch [m]."""
    if z * change < 0.0:
        if abs(change) <= abs(z):
            return z + change
        change, z = z + change, 0.0
    end = width if change > 0.0 else -width
    return end + (z - end) * exp(-abs(change) / width)


def bouc_wen(tension, stretch, stiffness, fraction, width, z, stretch_before):
    """Tension [N] of a wire part of whose stiffness yields (Bouc-Wen with n = 1, beta = gamma): plastic fibres, knots.

        T_c = (1 - fraction) T + fraction k z          dz/dx = 1 - z / width while z and x' agree in sign, 1 otherwise

    z is advanced exactly over a change of stretch x.
    """
    return (1.0 - fraction) * tension + fraction * stiffness * plastic(z, stretch - stretch_before, width)


def settle_bouc_wen(dt, stretched, fraction, width, z, stretch_before):
    """Z and the stretch it has seen [m]."""
    return plastic(z, stretched - stretch_before, width), stretched


def add_garment(tension, stiffness, garment):
    """Tension [N] of wire and garment in series: T_c = k_s (s - l); 1 / k_s = 1 / k + 1 / stiffness."""
    return tension * garment / (stiffness + garment)


def move_end(own, change, cone):
    """Stretches [m] of the pieces, in order from the end that moves, after it moved by `change` [m] (> 0 stretches)."""
    ratio = cone if change > 0.0 else 1.0 / cone  # of the stretches beside a bend that slips
    first, count, sum_slipping = own[0] + change, 1, own[0] + change
    while count < PIECES:
        nearer, farther = first * ratio ** (count - 1.0), own[count]
        if farther >= ratio * nearer if ratio < 1.0 else farther <= ratio * nearer:
            break  # the bend holds
        sum_slipping += own[count]
        count += 1
        total, one = 0.0, 1.0
        for _ in range(count):
            total, one = total + one, one * ratio
        first = max(0.0, sum_slipping / total)
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


def reverse(own):
    """Pieces in reverse order."""
    return own[4], own[3], own[2], own[1], own[0]


def settle_sheath(dt, stretched, travel, mu_phi, e1, e2, e3, e4, e5):
    """Stretches [m] of the pieces from cell to finger, after finger's and spool's end have moved, however fast.

    The finger's end goes first where it stretches the wire (travel < 0), so that the wire never runs slack between.
    """
    cone, own = exp(-mu_phi / BENDS), (e1, e2, e3, e4, e5)
    change = stretched + travel - (e1 + e2 + e3 + e4 + e5)
    if travel < 0.0:
        return move_end(reverse(move_end(reverse(own), -travel, cone)), change, cone)
    return reverse(move_end(reverse(move_end(own, change, cone)), -travel, cone))


def near_end(tension, stretched, travel, mu_phi, e1, e2, e3, e4, e5):
    """Tension at the cell's end [N], from that of a wire that is stretched alike all along.

        T_(i+1) / T_i within exp(-a) .. exp(+a)        a = mu_phi / 4          T_i = 5 k e_i          sum e_i = stretch

    Five pieces of wire in series, four bends of the sheath between them, each a capstan. A bend holds the wire while
    the ratio of the tensions beside it lies inside the cone; else it lets the wire slip until the ratio is at the edge.
    So a motion of either end reaches only as far as it must: a spool that reverses against a finger that does not move
    shows hysteresis, and the finger keeps its tension for a while. Quasi-static and rate-free; each end of the wire is
    moved in turn and solved exactly. In full slip T_finger = T_cell exp(-mu_phi), as in `tendon.capstan_friction`.
    """
    if stretched <= 0.0:
        return tension
    return tension * PIECES * settle_sheath(0.0, stretched, travel, mu_phi, e1, e2, e3, e4, e5)[0] / stretched


def far_end(tension, stretched, travel, mu_phi, e1, e2, e3, e4, e5):
    """Tension at the finger's end [N], from that at the cell's end."""
    pieces = settle_sheath(0.0, stretched, travel, mu_phi, e1, e2, e3, e4, e5)
    return tension * pieces[4] / pieces[0] if pieces[0] > 0.0 else tension


def settle_capstan(dt, tension, travel, mu_phi, force):
    """Force of the sheath's friction [N] after a further travel [m], however fast; tension at the cell's end [N]."""
    low, high = tension * (1.0 - exp(mu_phi)), tension * (1.0 - exp(-mu_phi))
    return slip_spring(force, travel, find_stiffness(mu_phi, PRESLIDING), low, high)


def capstan(tension, travel, mu_phi, force):
    """Tension at the finger [N] behind sheath friction proportional to load (capstan law).

        T_d = T_c - F          T_c (1 - exp(mu_phi)) <= F <= T_c (1 - exp(-mu_phi))          F of `friction.slip_spring`

    While the finger takes wire in T_d = T_c exp(-mu_phi), while it gives wire back T_d = T_c exp(mu_phi).
    """
    return tension - settle_capstan(0.0, tension, travel, mu_phi, force)


def coulomb(tension, slide, force):
    """Tension at the finger [N] behind friction of any load: T_d = T_c - force slide; slide -> 1 where it takes in."""
    return tension - force * slide


def stribeck(tension, slide, force, ratio, stribeck_speed, remembered):
    """Tension at the finger [N] behind Coulomb friction with a higher level near standstill.

        T_d = T_c - level(v) slide          level(v) = force (1 + (ratio - 1) exp(-(v / v_s)^2))

    The level follows the speed with a short frictional memory (frictional lag: Armstrong-Helouvry et al., Automatica
    30(7), 1994): a level that fell at once with speed would be a negative damper that no fixed step survives.
    """
    return tension - level(remembered, force, ratio, stribeck_speed) * slide


def settle_stribeck(dt, travel, force, ratio, stribeck_speed, remembered):
    """Remembered speed [m/s]."""
    return relax(remembered, travel / dt, dt, MEMORY)


def limit_to_grip(bristle, tension):
    """Bristle [-1 .. 1], no further bent than a wire under this tension [N] can hold it."""
    most = grip(tension)
    return min(max(bristle, -most), most)


def settle_dahl(dt, tension, travel, force, stiffness, bristle):
    """Bristle [-1 .. 1] after a further travel [m], however fast."""
    return limit_to_grip(bend_bristle(bristle, travel, force / stiffness), tension)


def dahl(tension, travel, force, stiffness, bristle):
    """Tension at the finger [N] behind Dahl's friction: T_d = T_c - F; dF/dx = stiffness (1 - F sgn(x') / force)."""
    return tension - force * settle_dahl(0.0, tension, travel, force, stiffness, bristle)


def limit_deflection(z, tension, most):
    """Deflection [m] that a wire under this tension [N] holds, `most` of a taut one."""
    return most * limit_to_grip(z / most, tension)


def lugre(tension, travel, speed, coulomb, ratio, stribeck_speed, stiffness, damping, z):
    """Tension at the finger [N] behind LuGre friction: presliding, break-away, Stribeck's fall and damping in one law.

        T_d = T_c - F(v, z)          F of `friction.deflect_bristle`, v > 0 while the finger takes wire in

    The part sigma_2 v is `tendon.viscous_friction`.
    """
    after = deflect_bristle(z, travel, level(speed, coulomb, ratio, stribeck_speed), stiffness)
    rate = speed * (after - z) / travel if travel != 0.0 else 0.0  # of the deflection, its mean over the tick
    return (
        tension
        - damping * grip(tension) * rate
        - stiffness * limit_deflection(after, tension, ratio * coulomb / stiffness)
    )


def settle_lugre(dt, tension, travel, coulomb, ratio, stribeck_speed, stiffness, damping, z):
    """Deflection of the bristle [m]."""
    after = deflect_bristle(z, travel, level(travel / dt, coulomb, ratio, stribeck_speed), stiffness)
    return limit_deflection(after, tension, ratio * coulomb / stiffness)


def settle_stops(dt, tension, travel, force, distance, first, second, third):
    """The stops [-1 .. 1] after a further travel [m], however fast, of a wire under this tension [N]."""
    return (
        limit_to_grip(turn_bristle(first, travel, distance), tension),
        limit_to_grip(turn_bristle(second, travel, 2.0 * distance), tension),
        limit_to_grip(turn_bristle(third, travel, STOPS * distance), tension),
    )


def prandtl_ishlinskii(tension, travel, force, distance, first, second, third):
    """Tension at the finger [N] behind stops of range i distance: T_d = T_c - force (z_1 + z_2 + z_3) / 3."""
    after = settle_stops(0.0, tension, travel, force, distance, first, second, third)
    return tension - force * ((after[0] + after[1] + after[2]) / STOPS)


def viscous(tension, speed, coefficient):
    """Tension at the finger [N] behind viscous friction: T_d = T_c - coefficient v; v > 0 where it takes wire in."""
    return tension - coefficient * speed * grip(tension)


SLACK = Effect(
    id="tendon.slack", summary="wire longer than assumed", family="offset",
    signature="constant stroke offset at every tension; tension stays 0 while the first stroke is taken in",
    source="physics.md 4.B; 0.5-5 mm; toe of the braid and its anchor assumed", at={"tendon.stretch": take_up_slack},
    parameters=(per_tendon("length", "m", null=0.0, low=1e-4, high=5e-3, default=1e-3),
                per_tendon("toe", "m", null=1e-4, low=2e-5, high=1e-3, default=1e-4, transform="log")),
    same_meaning=True,
)  # fmt: skip
CREEP = Effect(
    id="tendon.creep", summary="delayed elongation of the wire (standard linear solid)", family="viscoelasticity",
    signature="stroke drifts at held tension and remembers load; loop of angle against stroke, smaller in fast motion",
    source="physics.md 4.B; 10-40 % of the elastic stretch, 1-300 s",
    at={"tendon.stretch": subtract_creep, "tendon.settle": settle_creep},
    parameters=(per_tendon("stiffness", "N/m", null=inf, low=1500.0, high=6e4, default=8000.0, transform="reciprocal"),
                per_tendon("time_constant", "s", null=10.0, low=0.5, high=100.0, default=10.0, transform="log")),
    states=(State("elongation", TENDONS, unit="m"),), advances=("tendon.settle",), law_std=ANY_SHAPE,
)  # fmt: skip
STIFFENING = Effect(
    id="tendon.stiffening", summary="wire stiffens as it is stretched", family="elasticity",
    signature="stroke offset is a curved function of tension, steep at low tension, without a loop",
    source="physics.md 4.B, garment k0 + k1 T [A]; softer than the wire of 2700 N/m",
    at={"tendon.elastic": stiffen_wire},
    parameters=(
        per_tendon("soft_stiffness", "N/m", null=inf, low=500.0, high=2500.0, default=1200.0, transform="reciprocal"),
        per_tendon("stiffening", "1/m", null=200.0, low=30.0, high=500.0, default=200.0, transform="log")),
    law_std=ANY_SHAPE,
)  # fmt: skip
BOUC_WEN = Effect(
    id="tendon.bouc_wen", summary="part of the wire's stiffness yields", family="hysteresis",
    signature="loop of angle against stroke whose width follows amplitude, rate-free; less tension where stretch grows",
    source="physics.md 4.B; alpha 0.6-1", at={"tendon.elastic": bouc_wen, "tendon.settle": settle_bouc_wen},
    parameters=(per_tendon("fraction", "-", null=0.0, low=0.05, high=0.6, default=0.3),
                per_tendon("width", "m", null=5e-4, low=1e-4, high=3e-3, default=5e-4, transform="log")),
    states=(State("yielding", TENDONS, unit="m"), State("stretch_before", TENDONS, unit="m")),
    advances=("tendon.settle",),
    not_tried="another law of a wire that loses energy; tendon.creep and tendon.coulomb_friction are tried",
)  # fmt: skip
COMPLIANCE = Effect(
    id="tendon.compliance", summary="garment or anchor yields at the finger, in series with the wire",
    family="elasticity",
    signature="stroke offset proportional to tension, without a loop and at every rate; angle against tension as ever",
    source="physics.md 4.B; 0.5-10 N/mm [A]", at={"tendon.elastic": add_garment},
    parameters=(per_tendon("stiffness", "N/m", null=inf, low=5e2, high=2e4, default=3e3, transform="reciprocal"),),
    law_std=ANY_SHAPE,
)  # fmt: skip
SHEATH_FRICTION = Effect(
    id="tendon.sheath_friction", summary="sheath friction spread along an elastic wire", family="friction",
    signature="as capstan friction, and loops of tension against stroke at a finger held still",
    source="Kaneko et al., IEEE T-RA 7(3), 1991; Agrawal et al., IEEE T-RO 26(6), 2010",
    at={"tendon.near_end": near_end, "tendon.far_end": far_end, "tendon.settle": settle_sheath},
    parameters=(per_tendon("mu_phi", "-", null=0.0, low=0.05, high=0.9, default=0.3),),
    states=(State("stretches", TENDONS, PIECES, "m"),), advances=("tendon.settle",),
    not_tried="another law of tendon.capstan_friction, which is tried",
)  # fmt: skip
CAPSTAN_FRICTION = Effect(
    id="tendon.capstan_friction", summary="sheath friction proportional to load, between cell and finger",
    family="friction",
    signature="loop of angle against tension whose width grows with load, rate-free; none of angle against stroke",
    source="physics.md 4.B; mu phi 0.1-0.9 from exosuit Bowden efficiency 40-60 % [S:Stillsuit], 60 % [S:TUM]",
    at={"tendon.transmit": capstan, "tendon.settle": settle_capstan},
    parameters=(per_tendon("mu_phi", "-", null=0.0, low=0.05, high=0.9, default=0.3),),
    states=(State("force", TENDONS, unit="N"),), advances=("tendon.settle",),
)  # fmt: skip
COULOMB_FRICTION = Effect(
    id="tendon.coulomb_friction", summary="load-independent friction on the wire", family="friction",
    signature="loop of angle against tension of constant width, rate-free; none of angle against stroke",
    source="physics.md 4.B; 0.1-1 N", at={"tendon.transmit": coulomb},
    parameters=(per_tendon("force", "N", null=0.0, low=0.05, high=1.5, default=0.4),),
)  # fmt: skip
STRIBECK_FRICTION = Effect(
    id="tendon.stribeck_friction", summary="Coulomb friction with a higher level near standstill", family="friction",
    signature="as Coulomb friction, but the loop is wider at slow motion; break-away peaks, stick-slip",
    source="physics.md 4.B; static over sliding 1-1.5, 1-5 mm/s",
    at={"tendon.transmit": stribeck, "tendon.settle": settle_stribeck},
    parameters=(per_tendon("force", "N", null=0.0, low=0.05, high=1.5, default=0.3),
                per_tendon("ratio", "-", null=1.0, low=1.1, high=3.0, default=2.0),
                per_tendon("speed", "m/s", null=0.005, low=0.001, high=0.03, default=0.005, transform="log")),
    states=(State("remembered", TENDONS, unit="m/s"),), advances=("tendon.settle",),
)  # fmt: skip
PRESLIDING_FRICTION = Effect(
    id="tendon.presliding", summary="dry friction with a soft onset (Dahl)", family="friction",
    signature="loop of angle against tension that opens gradually after a reversal; nested minor loops in small motion",
    source="physics.md 4.B; 1e3-1e5 N/m", at={"tendon.transmit": dahl, "tendon.settle": settle_dahl},
    parameters=(per_tendon("force", "N", null=0.0, low=0.05, high=1.5, default=0.4),
                per_tendon("stiffness", "N/m", null=500.0, low=50.0, high=1e4, default=500.0, transform="log")),
    states=(State("bristle", TENDONS),), advances=("tendon.settle",),
    not_tried="another law of tendon.coulomb_friction, which is tried",
)  # fmt: skip
LUGRE = Effect(
    id="tendon.lugre", summary="LuGre friction: presliding, break-away peak and damping of the bristle",
    family="friction",
    signature="loop of angle against tension that opens gradually after a reversal and is wider at slow motion",
    source="Canudas de Wit et al., IEEE T-AC 40(3), 1995; physics.md 4.B; ranges assumed",
    at={"tendon.transmit": lugre, "tendon.settle": settle_lugre},
    parameters=(per_tendon("force", "N", null=0.0, low=0.05, high=1.5, default=0.4),
                per_tendon("ratio", "-", null=1.0, low=1.0, high=2.0, default=1.4),
                per_tendon("speed", "m/s", null=0.005, low=0.002, high=0.03, default=0.005, transform="log"),
                per_tendon("stiffness", "N/m", null=1000.0, low=100.0, high=1e4, default=1000.0, transform="log"),
                per_tendon("damping", "N s/m", null=5.0, low=0.5, high=20.0, default=5.0, transform="log")),
    states=(State("deflection", TENDONS, unit="m"),), advances=("tendon.settle",),
    not_tried="another law of tendon.stribeck_friction, which is tried",
)  # fmt: skip
PRANDTL_ISHLINSKII = Effect(
    id="tendon.prandtl_ishlinskii", summary="dry friction spread over contacts that let go one after the other",
    family="friction", signature="nested, rate-free loops of angle against tension, with corners where contacts let go",
    source="physics.md 4.B; 0-1 mm", at={"tendon.transmit": prandtl_ishlinskii, "tendon.settle": settle_stops},
    parameters=(per_tendon("force", "N", null=0.0, low=0.05, high=1.5, default=0.4),
                per_tendon("distance", "m", null=5e-4, low=5e-5, high=2e-3, default=5e-4, transform="log")),
    states=(State("stops", TENDONS, 3),), advances=("tendon.settle",),
    not_tried="another law of tendon.coulomb_friction, which is tried",
)  # fmt: skip
VISCOUS_FRICTION = Effect(
    id="tendon.viscous_friction", summary="friction proportional to wire speed", family="friction",
    signature="loop of angle against tension whose width grows with speed and vanishes at rest",
    source="physics.md 4.B; 0.5-5 N s/m", at={"tendon.transmit": viscous},
    parameters=(per_tendon("coefficient", "N s/m", null=0.0, low=0.5, high=20.0, default=5.0),),
)  # fmt: skip
