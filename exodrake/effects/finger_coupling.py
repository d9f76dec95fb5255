"""DIP tied to PIP by the digital tendons, as a spring between the two.

E = stiffness (q_DIP - ratio q_PIP)^2 / 2          tau = -dE/dq
"""

from exodrake.core.effect import Effect, EffectParameter


def external(torque, angle, rate, bones, clock, stiffness, ratio):
    """Torques on the joints [N m]."""
    tie = stiffness * (angle[2] - ratio * angle[1])
    return torque[0], torque[1] + ratio * tie, torque[2] - tie


EFFECT = Effect(
    id="finger.coupling",
    summary="DIP tied to PIP by the digital tendons",
    signature="DIP follows PIP whatever pulls it; errors of the two joints go together",
    source="physics.md 4.D; ratio about 0.67, 0-0.03 N m/rad",
    at={"finger.external": external},
    parameters=(
        EffectParameter("stiffness", "N m/rad", null=0.0, low=0.002, high=0.1, default=0.02),
        EffectParameter("ratio", "-", null=0.67, low=0.3, high=1.2, default=0.67),
    ),
    family="elasticity",
    order=445,
)
