"""Dry friction spread over many contacts that let go one after the other (Prandtl-Ishlinskii: a sum of stops).

T_d = T_c - force (z_1 + z_2 + z_3) / 3          z_i: stop operator of range i distance
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.bristle import clipped
from exodrake.effects.friction.grip import kept

STOPS = 3.0


def mean_stop(first, second, third):
    """Mean of the stops [-1 .. 1]."""
    return (first + second + third) / STOPS


def moved(tension, travel, distance, first, second, third):
    """The stops after a further travel [m] of a wire under this tension [N]."""
    return (
        kept(clipped(first, travel, distance), tension),
        kept(clipped(second, travel, 2.0 * distance), tension),
        kept(clipped(third, travel, STOPS * distance), tension),
    )


def transmit(tension, slide, travel, speed, force, distance, first, second, third):
    """Tension at the finger [N]."""
    stops = moved(tension, travel, distance, first, second, third)
    return tension - force * mean_stop(stops[0], stops[1], stops[2])


def settle(dt, stretched, tension, tension_finger, travel, force, distance, first, second, third):
    """The stops [-1 .. 1]."""
    return moved(tension, travel, distance, first, second, third)


EFFECT = Effect(
    id="tendon.prandtl_ishlinskii",
    summary="dry friction spread over contacts that let go one after the other",
    signature="nested, rate-free loops of angle against tension, with corners where contacts let go",
    source="physics.md 4.B; 0-1 mm",
    at={"tendon.transmit": transmit, "tendon.settle": settle},
    parameters=(
        EffectParameter("force", "N", null=0.0, low=0.05, high=1.5, axis=TENDONS, default=0.4),
        EffectParameter("distance", "m", null=5e-4, low=5e-5, high=2e-3, axis=TENDONS, default=5e-4, transform="log"),
    ),
    states=(State("stops", TENDONS, 3),),
    advances=("tendon.settle",),
    family="friction",
    not_tried="another law of tendon.coulomb_friction, which is tried",
    order=250,
)
