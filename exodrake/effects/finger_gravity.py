"""Weight of the phalanges. Pitch 0: palm down, finger horizontal, gravity flexes; pi: palm up.

Q_i = acceleration moment_i cos(phi_i + pitch)          tau_i = Q_i + .. + Q_3          phi_i = q_1 + .. + q_i
"""

from math import cos, pi

from exodrake.core.effect import Effect, EffectParameter


def external(torque, angle, rate, bones, clock, acceleration, pitch):
    """Torques on the joints [N m]; bones: (lengths [m], first moments [kg m])."""
    moments = bones[1]
    phi_1 = angle[0] + pitch
    phi_2 = phi_1 + angle[1]
    distal = acceleration * moments[2] * cos(phi_2 + angle[2])
    middle = distal + acceleration * moments[1] * cos(phi_2)
    return torque[0] + middle + acceleration * moments[0] * cos(phi_1), torque[1] + middle, torque[2] + distal


EFFECT = Effect(
    id="finger.gravity",
    summary="weight of the phalanges",
    signature="angle offset that does not depend on tension, largest at the MCP, and turns round with the palm",
    source="physics.md 4.D; 7, 1.4, 0.3 mN m with the finger straight and horizontal",
    at={"finger.external": external},
    parameters=(
        EffectParameter("acceleration", "m/s2", null=0.0, low=9.78, high=9.84, default=9.81, fitted=False),
        EffectParameter("pitch", "rad", null=0.0, low=-pi / 2, high=3 * pi / 2, default=0.0, period=2 * pi),
    ),
    family="load",
    same_meaning=True,
    order=450,
)
