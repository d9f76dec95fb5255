"""Fingertip meets a flat object parallel to the palm.

    y = sum L_i sin(phi_i)          F = stiffness (y - distance) beyond the surface          tau_i = -F dy/dq_i

The pulp of the finger rounds the force's onset off over a depth of ONSET and stiffens as it is pressed: `stiffness` is
the secant at a depth of SECANT, from where the force rises by the power `exponent` of the depth.
"""

from math import cos, inf, sin

from exodrake.core.effect import Effect, EffectParameter

ONSET = 5e-5  # depth over which the force sets in [m]; assumed
SECANT = 1e-3  # depth at which the stiffness is that of the law without exponent [m]


def pressed(depth, stiffness, exponent):
    """Force of the object [N] at this depth [m]."""
    if depth <= 0.0:
        return 0.0
    steeper = (depth / SECANT) ** (exponent - 1.0)
    if depth < ONSET:
        return 0.5 * stiffness * depth * depth / ONSET * steeper
    return stiffness * (depth - 0.5 * ONSET) * steeper


def external(torque, angle, rate, bones, clock, distance, stiffness, exponent):
    """Torques on the joints [N m]; bones: (lengths [m], first moments [kg m])."""
    length = bones[0]
    phi_2 = angle[0] + angle[1]
    phi_3 = phi_2 + angle[2]
    tip = length[0] * sin(angle[0]) + length[1] * sin(phi_2) + length[2] * sin(phi_3)
    force = pressed(tip - distance, stiffness, exponent)
    third = length[2] * cos(phi_3)
    second = third + length[1] * cos(phi_2)
    first = second + length[0] * cos(angle[0])
    return torque[0] - force * first, torque[1] - force * second, torque[2] - force * third


EFFECT = Effect(
    id="finger.contact",
    summary="fingertip meets a flat object parallel to the palm",
    signature="angles stop short beyond a posture while tension goes on rising; nothing before that posture",
    source="physics.md 4.D; 1-10 N/mm; motions up to 12 N reach 58-80 mm; exponent: Hertz 3/2",
    at={"finger.external": external},
    parameters=(
        EffectParameter("distance", "m", null=inf, low=0.03, high=0.055, default=0.045, transform="reciprocal"),
        EffectParameter("stiffness", "N/m", null=2000.0, low=100.0, high=1e4, default=2000.0, transform="log"),
        EffectParameter("exponent", "-", null=1.0, low=1.0, high=2.0, default=1.2),
    ),
    family="contact",
    order=455,
)
