"""Friction: the laws that several parts share, then `sliding.*`, those of any sliding or turning part.

A bristle is what stands between two rubbing surfaces and turns round over a width of travel. `bend_bristle` is Dahl's
law: rate-free, never beyond 1, and dissipative in every closed loop.
"""

from math import exp

from exodrake.model.effect import Effect, EffectParameter
from exodrake.model.part import State
from exodrake.physics.arithmetic import brake_dry

LOAD = 4.0  # tension at which a presliding travel is stated [N]: in the middle of the wires' ranges


def bend_bristle(bristle, travel, width):
    """Bristle [-1 .. 1] after a further travel [same unit as width], exact: dz/dx = (1 - z sgn(x')) / width."""
    end = 1.0 if travel > 0.0 else -1.0
    return end + (bristle - end) * exp(-abs(travel) / width)


def settle_bristle(dt, value, size, width, bristle, before):
    """Bristle [-1 .. 1], and the value that it has seen [unit of width]."""
    return bend_bristle(bristle, value - before, width), value


def turn_bristle(bristle, travel, width):
    """The same with a straight rise: stiff up to the end, then sliding [-1 .. 1]."""
    return min(max(bristle + travel / width, -1.0), 1.0)


def level(speed, coulomb, ratio, stribeck_speed):
    """Stribeck curve g(v): friction in steady sliding at this speed [unit of coulomb]; coulomb: F_c; ratio: F_s / F_c.

        g(v) = F_c + (F_s - F_c) exp(-(v / v_s)^2)

    Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994, with the exponent 2.
    """
    return coulomb * (1.0 + (ratio - 1.0) * exp(-(speed / stribeck_speed) * (speed / stribeck_speed)))


def deflect_bristle(z, travel, steady, stiffness):
    """Deflection of LuGre's bristle [m] after a travel [m]; steady: g(v) [N]; stiffness: sigma_0 [N/m].

        z' = v - sigma_0 |v| z / g(v)          g(v) of `level`
        F = sigma_0 z + sigma_1 z' + sigma_2 v

    It is exact for a speed held over the step (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE T-AC 40(3), 1995).
    """
    end = steady / stiffness if travel > 0.0 else -steady / stiffness
    return end + (z - end) * exp(-abs(travel) * stiffness / steady)


def find_stiffness(friction, presliding):
    """Stiffness [N/m] of friction of `friction` times the load that builds up over `presliding` [m] at LOAD."""
    return friction * LOAD / presliding


def slip_spring(force, travel, stiffness, low, high):
    """Force [N] after a further travel [m] of a spring that slips; low <= 0 <= high: limits of the present load [N].

        dF = stiffness dx          low <= F <= high          the limits follow the load, the stiffness does not

    The energy F^2 / (2 stiffness) that the spring stores does not depend on the load: where the load falls at
    standstill the spring slips and loses energy, where it rises the force stays. A bristle in -1 .. 1 times the load
    would be given energy by every rise of the load, and a cycle of load and motion could take it out. Yang, Chu, Menq,
    J. Sound Vib. 210(4), 1998 (Jenkins element under variable normal load).
    """
    return min(max(force + stiffness * travel, low), high)


def viscous(force, speed, coefficient):
    """Force on the part [N] under friction proportional to speed: F_net = F - coefficient v."""
    return force - coefficient * speed


def resist_by_direction(force, speed, coefficient):
    """Force on the part [N] with more viscous friction forwards than back: F_net = F - coefficient |v|."""
    return force - coefficient * abs(speed)


def subtract_force(drive_force, force):
    """Force on the part [N] against a constant one, as of tilt or a spring: F_net = F - force."""
    return drive_force - force


def coulomb(speed, mobility, force):
    """Speed [m/s] after a tick of dry friction: v <- v - sgn(v) min(|v|, force dt / M); mobility = dt / M."""
    return brake_dry(speed, force * mobility)


def brake_by_load(speed, mobility, load, coefficient):
    """Speed [m/s] after a tick of friction by a load: v <- v - sgn(v) min(|v|, coefficient |F| dt / M)."""
    return brake_dry(speed, coefficient * abs(load) * mobility)


def stribeck(speed, mobility, force, ratio, stribeck_speed):
    """Speed [m/s] after a tick of dry friction g(v) (`level`): v <- v - sgn(v) min(|v|, g(v) dt / M)."""
    return brake_dry(speed, level(speed, force, ratio, stribeck_speed) * mobility)


def presliding_force(drive_force, force, presliding, slide):
    """Force on the part [N] with presliding friction: F_net = F - force slide; slide' = v / presliding in -1 .. 1."""
    return drive_force - force * slide


def settle_presliding(dt, travel, force, presliding, slide):
    """How far the contact has yielded, -1 .. 1, sliding at both ends."""
    return turn_bristle(slide, travel, presliding)


def lugre_force(drive_force, speed, force, ratio, stribeck_speed, presliding, damping, z):
    """Force on the part [N] under LuGre friction: presliding, break-away, Stribeck's fall, damping of the bristle.

        F_net = F - sigma_0 z - sigma_1 z'          sigma_0 = force / presliding          z of `deflect_bristle`

    The part sigma_2 v is `sliding.viscous_friction`.
    """
    stiffness = force / presliding
    rate = speed - stiffness * abs(speed) * z / level(speed, force, ratio, stribeck_speed)
    return drive_force - stiffness * z - damping * rate


def settle_lugre(dt, travel, force, ratio, stribeck_speed, presliding, damping, z):
    """Deflection of the bristle [m]."""
    return deflect_bristle(z, travel, level(travel / dt, force, ratio, stribeck_speed), force / presliding)


VISCOUS_FRICTION = Effect(
    id="sliding.viscous_friction", summary="friction proportional to speed", family="friction",
    signature="force that the drive needs grows with speed, the same in both directions",
    source="Newton's law of a lubricated gap; Janot, Gautier, Brunot 2019 (EMPS): 203.5 N s/m for 95 kg",
    at={"sliding.pushed": viscous},
    parameters=(EffectParameter("coefficient", "force/speed", null=0.0, low=0.13, high=4.0, default=1.0),),
)  # fmt: skip
DIRECTION = Effect(
    id="sliding.direction", summary="viscous friction differs from one direction to the other", family="friction",
    signature="the drive needs more force one way than the other, the more the faster",
    source="Janot, Gautier, Brunot 2019 (EMPS): asymmetric friction lowers the error from 4.08 to 3.11 %",
    at={"sliding.pushed": resist_by_direction},
    parameters=(EffectParameter("coefficient", "force/speed", null=0.0, low=-1.0, high=1.0, default=0.13),),
)  # fmt: skip
OFFSET = Effect(
    id="sliding.offset", summary="a constant force: tilt, or the zero of the amplifier", family="offset",
    signature="the drive needs more force one way than the other, by the same amount at every speed",
    source="Janot, Gautier, Brunot 2019 (EMPS): -3.16 N of 200 N; range assumed", at={"sliding.pushed": subtract_force},
    parameters=(EffectParameter("force", "force", null=0.0, low=-1.0, high=1.0, default=0.2),), same_meaning=True,
)  # fmt: skip
COULOMB_FRICTION = Effect(
    id="sliding.coulomb_friction", summary="dry friction", family="friction",
    signature="force that the drive needs jumps at each reversal by twice the friction, whatever the speed",
    source="Coulomb's law; Janot, Gautier, Brunot 2019 (EMPS): 20.39 N; range assumed", at={"sliding.braked": coulomb},
    parameters=(EffectParameter("force", "force", null=0.0, low=0.13, high=4.0, default=1.0),),
)  # fmt: skip
LOAD_FRICTION = Effect(
    id="sliding.load_friction", summary="dry friction proportional to the force on the drive", family="friction",
    signature="the drive needs more force in proportion to the force it gives, accelerating as braking",
    source="gear and screw efficiency 0.5-0.98; Duclusaud et al., ICRA 2025 (Rhoban/bam M3, M4: of servos, whose gears "
    "carry motor and load)",
    at={"sliding.braked": brake_by_load},
    parameters=(EffectParameter("coefficient", "-", null=0.0, low=0.02, high=0.6, default=0.15),),
)  # fmt: skip
STRIBECK_FRICTION = Effect(
    id="sliding.stribeck_friction", summary="dry friction with a higher level near standstill", family="friction",
    signature="as dry friction, with more force at slow motion",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994; range assumed", at={"sliding.braked": stribeck},
    parameters=(EffectParameter("force", "force", null=0.0, low=0.13, high=4.0, default=1.0),
                EffectParameter("ratio", "-", null=1.0, low=1.1, high=3.0, default=1.5),
                EffectParameter("speed", "speed", null=0.1, low=0.02, high=1.0, default=0.1, transform="log")),
)  # fmt: skip
PRESLIDING_FRICTION = Effect(
    id="sliding.presliding_friction", summary="dry friction that builds up over the first travel after a reversal",
    family="friction",
    signature="as dry friction, but the force that the drive needs turns over a fixed travel and not at once",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994 (presliding displacement); range assumed",
    at={"sliding.pushed": presliding_force, "sliding.settle": settle_presliding},
    parameters=(EffectParameter("force", "force", null=0.0, low=0.13, high=4.0, default=1.0),
                EffectParameter("presliding", "length", null=1e-3, low=2e-4, high=1e-2, default=1e-3, transform="log")),
    states=(State("slide"),), advances=("sliding.settle",),
)  # fmt: skip
LUGRE = Effect(
    id="sliding.lugre", summary="LuGre friction", family="friction",
    signature="as dry friction that builds up over the first travel, with a break-away peak and damping in presliding",
    source="Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE T-AC 40(3), 1995; ranges assumed",
    at={"sliding.pushed": lugre_force, "sliding.settle": settle_lugre},
    parameters=(EffectParameter("force", "force", null=0.0, low=0.13, high=4.0, default=1.0),
                EffectParameter("ratio", "-", null=1.0, low=1.0, high=2.0, default=1.4),
                EffectParameter("speed", "speed", null=0.1, low=0.02, high=1.0, default=0.1, transform="log"),
                EffectParameter("presliding", "length", null=1e-3, low=2e-4, high=1e-2, default=1e-3, transform="log"),
                EffectParameter("damping", "force/speed", null=1.0, low=0.1, high=10.0, default=1.0, transform="log")),
    states=(State("deflection", unit="length"),), advances=("sliding.settle",),
    not_tried="five parameters; dry friction with a peak or with presliding, which it joins, is tried",
)  # fmt: skip
