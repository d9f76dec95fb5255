"""Part of the wire's stiffness yields (Bouc-Wen with n = 1, beta = gamma): plastic fibres and knots.

    T_c = (1 - fraction) T + fraction k z          dz/dx = 1 - z / width while z and x' agree in sign, 1 otherwise

z is advanced exactly over a change of stretch x.
"""

from math import exp

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS


def yielded(z, change, width):
    """Z [m] after a further change of stretch [m]."""
    if z * change < 0.0:
        if abs(change) <= abs(z):
            return z + change
        change, z = z + change, 0.0
    end = width if change > 0.0 else -width
    return end + (z - end) * exp(-abs(change) / width)


def elastic(tension, stretch, wire_stiffness, fraction, width, z, stretch_before):
    """Tension [N]."""
    return (1.0 - fraction) * tension + fraction * wire_stiffness * yielded(z, stretch - stretch_before, width)


def settle(dt, stretched, tension, tension_finger, travel, fraction, width, z, stretch_before):
    """Z and the stretch it has seen [m]."""
    return yielded(z, stretched - stretch_before, width), stretched


EFFECT = Effect(
    id="tendon.bouc_wen",
    summary="part of the wire's stiffness yields",
    signature="loop of angle against stroke whose width follows amplitude, rate-free; less tension where stretch grows",
    source="physics.md 4.B; alpha 0.6-1",
    at={"tendon.elastic": elastic, "tendon.settle": settle},
    parameters=(
        EffectParameter("fraction", "-", null=0.0, low=0.05, high=0.6, axis=TENDONS, default=0.3),
        EffectParameter("width", "m", null=5e-4, low=1e-4, high=3e-3, axis=TENDONS, default=5e-4, transform="log"),
    ),
    states=(State("yielding", TENDONS, unit="m"), State("stretch_before", TENDONS, unit="m")),
    advances=("tendon.settle",),
    family="hysteresis",
    not_tried="another law of a wire that loses energy; tendon.creep and tendon.coulomb_friction are tried",
    order=220,
)
