"""Garment deforms: router height changes with tension.

    h = h_drawn + migration T_s          T_s: tension at the finger, followed by the garment within SETTLING

An instant h(T) would close an algebraic loop of gain above 1 (more tension, more height, less tension).
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.relaxation import relaxed

SETTLING = 0.01  # time in which the garment follows the tension [s]; assumed


def worn_height(height, tension, migration, felt):
    """Router height under the wire [m]."""
    return height + migration * felt


def settle(dt, stretched, tension, tension_finger, travel, migration, felt):
    """Tension that the garment has relaxed under [N]."""
    return relaxed(felt, tension_finger, dt, SETTLING)


EFFECT = Effect(
    id="finger.router_migration",
    summary="garment deforms: router height changes with tension",
    signature="moment arm depends on tension at the same angle; extra stroke grows with tension and flexion",
    source="physics.md 4.D; 0.05-0.3 mm/N",
    at={"wire_paths.worn_height": worn_height, "tendon.settle": settle},
    parameters=(EffectParameter("migration", "m/N", null=0.0, low=1e-5, high=3e-4, axis=TENDONS, default=1e-4),),
    states=(State("felt", TENDONS, unit="N"),),
    advances=("tendon.settle",),
    family="geometry",
    order=410,
)
