"""Finger and wearer: passive joints, routers in the garment, and torques and contacts from outside.

At `finger.external` a law takes and returns the torques on all joints; bones: (lengths [m], first moments [kg m]).
"""

from math import cos, inf, pi, sin

from exodrake.effects.friction import bend_bristle, settle_bristle
from exodrake.effects.signal import relax, shift
from exodrake.model.effect import ANY_SHAPE, Effect, EffectParameter, per_joint, per_tendon
from exodrake.model.part import JOINTS, TENDONS, State

SETTLING = 0.01  # time in which the garment follows the tension [s]; assumed
TAUT = 15.0  # tension above which the garment is taut and lifts no further [N]; beyond all references; assumed
ONSET = 5e-5  # depth over which a contact's force sets in [m]; assumed
SECANT = 1e-3  # depth at which a contact's stiffness is that of the law without exponent [m]


def worn_height(height, migration, stored, felt):
    """Router height under the wire [m], which changes as the garment deforms.

        path      h = h_drawn + migration T_s          T_s: tension at the finger, followed within SETTLING
        torque    T R(h_drawn + (1 - stored / 2) migration T_s)

    The wire lifts the routers by dh against the garment and does the work T (dl/dh) dh. With stored = 1 the garment
    keeps it as an elastic body: stroke and torque derive from one co-energy W(T, q), so that no closed cycle gains
    energy. With stored = 0 the torque has the arm of the lifted path. An instant h(T) would close an algebraic loop of
    gain above 1.
    """
    return height + migration * felt


def lever_height(height, migration, stored, felt):
    """Router height with which the wire turns the joints [m]: R is linear in h: half the lift is its mean."""
    return height - 0.5 * stored * migration * felt


def settle_garment(dt, tension_finger, migration, stored, felt):
    """Tension that the garment has relaxed under [N]."""
    return relax(felt, min(tension_finger, TAUT), dt, SETTLING)


def scale_stiffness(torque, elastic, factor):
    """Passive torque [N m] of joints whose stiffness is scaled: tau_p = factor kappa (q - q0) + end stops."""
    return torque + (factor - 1.0) * elastic


def harden_joint(torque, bend, coefficient):
    """Passive torque [N m] with cubic stiffening: tau_p = kappa (q - q0) + coefficient (q - q0)^3 + end stops."""
    return torque + coefficient * bend * bend * bend


def stiffen_in_bouts(torque, elastic, clock, gain, frequency):
    """Passive torque [N m] in bouts: tau_p = kappa (q - q0) (1 + gain (1 - cos(2 pi frequency t)) / 2) + end stops."""
    return torque + 0.5 * gain * elastic * (1.0 - cos(2.0 * pi * frequency * clock))


def viscoelastic(torque, elastic, fraction, time_constant, relaxed_torque):
    """Passive torque [N m] of tissue that relaxes (standard linear solid).

    tau_p = elastic + fraction (elastic - w) + end stops          time_constant w' = elastic - w
    elastic = kappa (q - q0)
    """
    return torque + fraction * (elastic - relaxed_torque)


def relax_tissue(dt, elastic, fraction, time_constant, relaxed_torque):
    """Elastic torque that has relaxed [N m]."""
    return relax(relaxed_torque, elastic, dt, time_constant)


def hysteretic(passive_torque, bend, torque, width, bristle, bend_before):
    """Passive torque [N m] with a bristle: tau_p = elastic + torque z + end stops; dz/dq = (1 - z sgn(q')) / width."""
    return passive_torque + torque * bend_bristle(bristle, bend - bend_before, width)


def spastic(torque, rate, gain, threshold):
    """Passive torque [N m] of a wearer who resists flexion above a speed: tau_p = ... + gain max(0, q' - threshold)."""
    return torque + gain * max(0.0, rate - threshold)


def tie_joints(torque, angle, stiffness, ratio):
    """Torques on the joints [N m] with DIP tied to PIP by the digital tendons, as a spring between the two.

    E = stiffness (q_DIP - ratio q_PIP)^2 / 2          tau = -dE/dq
    """
    tie = stiffness * (angle[2] - ratio * angle[1])
    return torque[0], torque[1] + ratio * tie, torque[2] - tie


def add_weight(torque, angle, bones, acceleration, pitch):
    """Torques on the joints [N m] with the weight of the phalanges.

        Q_i = acceleration moment_i cos(phi_i + pitch)          tau_i = Q_i + .. + Q_3          phi_i = q_1 + .. + q_i

    Pitch 0: palm down, finger horizontal, gravity flexes; pi: palm up.
    """
    moments = bones[1]
    phi_1 = angle[0] + pitch
    phi_2 = phi_1 + angle[1]
    distal = acceleration * moments[2] * cos(phi_2 + angle[2])
    middle = distal + acceleration * moments[1] * cos(phi_2)
    return torque[0] + middle + acceleration * moments[0] * cos(phi_1), torque[1] + middle, torque[2] + distal


def press_object(depth, stiffness, exponent):
    """Force of the object [N] at this depth [m]."""
    if depth <= 0.0:
        return 0.0
    steeper = (depth / SECANT) ** (exponent - 1.0)
    if depth < ONSET:
        return 0.5 * stiffness * depth * depth / ONSET * steeper
    return stiffness * (depth - 0.5 * ONSET) * steeper


def meet_object(torque, angle, bones, distance, stiffness, exponent):
    """Torques on the joints [N m] as the fingertip meets a flat object parallel to the palm.

        y = sum L_i sin(phi_i)          F = stiffness (y - distance) beyond the surface          tau_i = -F dy/dq_i

    The pulp of the finger rounds the force's onset off over a depth of ONSET and stiffens as it is pressed: `stiffness`
    is the secant at a depth of SECANT, from where the force rises by the power `exponent` of the depth.
    """
    length = bones[0]
    phi_2 = angle[0] + angle[1]
    phi_3 = phi_2 + angle[2]
    tip = length[0] * sin(angle[0]) + length[1] * sin(phi_2) + length[2] * sin(phi_3)
    force = press_object(tip - distance, stiffness, exponent)
    third = length[2] * cos(phi_3)
    second = third + length[1] * cos(phi_2)
    first = second + length[0] * cos(angle[0])
    return torque[0] - force * first, torque[1] - force * second, torque[2] - force * third


def add_tremor(outside, clock, torque, frequency):
    """Torques on the joints [N m] with an oscillating one of the wearer's: tau_i = torque_i sin(2 pi frequency t)."""
    wave = sin(2.0 * pi * frequency * clock)
    return outside[0] + torque[0] * wave, outside[1] + torque[1] * wave, outside[2] + torque[2] * wave


def add_voluntary_torque(outside, clock, torque, growth):
    """Torques on the joints [N m] with the wearer's, steady or more and more: tau_i = torque_i (1 + growth_i t)."""
    first = torque[0] * (1.0 + growth[0] * clock)
    second = torque[1] * (1.0 + growth[1] * clock)
    return outside[0] + first, outside[1] + second, outside[2] + torque[2] * (1.0 + growth[2] * clock)


ROUTER_HEIGHT = Effect(
    id="finger.router_height", summary="routers sit higher or lower than drawn", family="geometry",
    signature="wrong moment arms: angle against stroke has another slope, angle against tension another gain; no loop",
    source="physics.md 4.D; 0.5-2 mm", at={"wire_paths.router_height": shift},
    formula="h = h_drawn + height          on both sides of the joint",
    parameters=(per_joint("height", "m", null=0.0, low=-1.5e-3, high=2e-3, default=5e-4),),
)  # fmt: skip
ROUTER_MIGRATION = Effect(
    id="finger.router_migration", summary="garment deforms: router height changes with tension", family="geometry",
    signature="moment arm depends on tension at the same angle; extra stroke grows with tension and flexion",
    source="physics.md 4.D; 0.05-0.3 mm/N",
    at={"wire_paths.worn_height": worn_height, "wire_paths.lever_height": lever_height,
        "tendon.settle": settle_garment},
    parameters=(per_tendon("migration", "m/N", null=0.0, low=1e-5, high=3e-4, default=1e-4),
                EffectParameter("stored", "-", null=1.0, low=0.0, high=1.0, default=1.0)),
    states=(State("felt", TENDONS, unit="N"),), advances=("tendon.settle",),
)  # fmt: skip
STIFFNESS = Effect(
    id="finger.stiffness", summary="passive stiffness scaled (another wearer, another day)", family="elasticity",
    signature="angle error proportional to deflection, without a loop; tension and stroke at given angle are off alike",
    source="physics.md 4.D; +-30 % between wearers and more with spasticity [S:SECA]",
    at={"finger.passive": scale_stiffness}, same_meaning=True,
    parameters=(per_joint("factor", "-", null=1.0, low=0.4, high=2.5, default=1.4, transform="log"),),
)  # fmt: skip
HARDENING = Effect(
    id="finger.hardening", summary="cubic stiffening of the joints", family="elasticity",
    signature="angle falls short at large flexion only, without a loop",
    source="physics.md 4.D, k0 + k1 (q - q0)^2 [A]", at={"finger.passive": harden_joint},
    parameters=(per_joint("coefficient", "N m/rad3", null=0.0, low=0.003, high=0.2, default=0.04),),
)  # fmt: skip
CO_ACTIVATION = Effect(
    id="finger.co_activation", summary="the wearer tenses flexors and extensors in bouts", family="disturbance",
    signature="angle error proportional to deflection that comes and goes at a slow frequency of its own",
    source="physics.md 4.D; stiffness up to threefold in activity", at={"finger.passive": stiffen_in_bouts},
    parameters=(per_joint("gain", "-", null=0.0, low=0.05, high=2.0, default=0.5),
                EffectParameter("frequency", "Hz", null=0.2, low=0.02, high=2.0, default=0.2, transform="log")),
    not_tried="rare: the wearer's own course of stiffness; finger.stiffness is tried",
)  # fmt: skip
VISCOELASTICITY = Effect(
    id="finger.viscoelasticity", summary="joint tissue relaxes (standard linear solid)", family="viscoelasticity",
    signature="angle creeps on at held tension; loop of angle against tension that depends on rate and fades when slow",
    source="physics.md 4.D; 10-30 %, 0.5-10 s", at={"finger.passive": viscoelastic, "finger.relax": relax_tissue},
    parameters=(per_joint("fraction", "-", null=0.0, low=0.03, high=0.8, default=0.3),
                per_joint("time_constant", "s", null=2.0, low=0.2, high=20.0, default=2.0, transform="log")),
    states=(State("relaxed_torque", JOINTS, unit="N m"),), advances=("finger.relax",), law_std=ANY_SHAPE,
)  # fmt: skip
HYSTERESIS = Effect(
    id="finger.hysteresis", summary="rate-independent loss in the joints", family="hysteresis",
    signature="loop of angle against tension and against stroke, rate-free, width independent of load",
    source="physics.md 4.D and 5 [A]", at={"finger.passive": hysteretic, "finger.relax": settle_bristle},
    names={"value": "bend"},
    parameters=(per_joint("torque", "N m", null=0.0, low=3e-4, high=1e-2, default=3e-3),
                per_joint("width", "rad", null=0.05, low=0.01, high=0.3, default=0.05, transform="log")),
    states=(State("bristle", JOINTS), State("bend_before", JOINTS, unit="rad")), advances=("finger.relax",),
)  # fmt: skip
SPASTICITY = Effect(
    id="finger.spasticity", summary="resists flexion above a speed", family="friction",
    signature="flexion held back at speed, extension and slow motion as nominal",
    source="physics.md 4.D; velocity threshold of the stretch reflex [A]; a moderate motion reaches 1-2 rad/s",
    at={"finger.passive": spastic},
    parameters=(per_joint("gain", "N m s/rad", null=0.0, low=1e-3, high=5e-2, default=0.01),
                per_joint("threshold", "rad/s", null=0.5, low=0.0, high=1.0, default=0.5)),
)  # fmt: skip
COUPLING = Effect(
    id="finger.coupling", summary="DIP tied to PIP by the digital tendons", family="elasticity",
    signature="DIP follows PIP whatever pulls it; errors of the two joints go together",
    source="physics.md 4.D; ratio about 0.67, 0-0.03 N m/rad", at={"finger.external": tie_joints},
    parameters=(EffectParameter("stiffness", "N m/rad", null=0.0, low=0.002, high=0.1, default=0.02),
                EffectParameter("ratio", "-", null=0.67, low=0.3, high=1.2, default=0.67)),
)  # fmt: skip
GRAVITY = Effect(
    id="finger.gravity", summary="weight of the phalanges", family="load",
    signature="angle offset that does not depend on tension, largest at the MCP, and turns round with the palm",
    source="physics.md 4.D; 7, 1.4, 0.3 mN m with the finger straight and horizontal",
    at={"finger.external": add_weight}, same_meaning=True,
    parameters=(EffectParameter("acceleration", "m/s2", null=0.0, low=9.78, high=9.84, default=9.81, fitted=False),
                EffectParameter("pitch", "rad", null=0.0, low=-pi / 2, high=3 * pi / 2, default=0.0, period=2 * pi)),
)  # fmt: skip
CONTACT = Effect(
    id="finger.contact", summary="fingertip meets a flat object parallel to the palm", family="contact",
    signature="angles stop short beyond a posture while tension goes on rising; nothing before that posture",
    source="physics.md 4.D; 1-10 N/mm; motions up to 12 N reach 58-80 mm; exponent: Hertz 3/2",
    at={"finger.external": meet_object},
    parameters=(EffectParameter("distance", "m", null=inf, low=0.03, high=0.055, default=0.045, transform="reciprocal"),
                EffectParameter("stiffness", "N/m", null=2000.0, low=100.0, high=1e4, default=2000.0, transform="log"),
                EffectParameter("exponent", "-", null=1.0, low=1.0, high=2.0, default=1.2)),
)  # fmt: skip
TREMOR = Effect(
    id="finger.tremor", summary="oscillating voluntary torque", family="disturbance",
    signature="spectral line in angle and tension at one frequency, whatever the reference does",
    source="physics.md 4.D; 6-12 Hz [S:Lakie], displacement mostly 1-3.5 Hz [S:Carignan]",
    at={"finger.external": add_tremor},
    parameters=(per_joint("torque", "N m", null=0.0, low=5e-4, high=3e-2, default=6e-3),
                EffectParameter("frequency", "Hz", null=4.0, low=1.0, high=12.0, default=4.0, transform="log")),
    detector="spectral_peak",
)  # fmt: skip
VOLUNTARY_TORQUE = Effect(
    id="finger.voluntary_torque", summary="the wearer pushes along", family="disturbance",
    signature="angle offset that depends neither on tension nor on rate, steady or growing along the log",
    source="physics.md 4.D; 1-50 mN m", at={"finger.external": add_voluntary_torque},
    parameters=(per_joint("torque", "N m", null=0.0, low=-0.02, high=0.02, default=6e-3),
                per_joint("growth", "1/s", null=0.0, low=-0.03, high=0.1, default=0.0)),
    not_tried="rare: the wearer's own course of torque, which takes up any slow error; finger.gravity is tried",
)  # fmt: skip
