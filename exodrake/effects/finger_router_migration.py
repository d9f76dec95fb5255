"""Garment deforms: router height changes with tension, and the garment stores the work that this takes.

    path      h = h_drawn + migration T_s          T_s: tension at the finger, followed by the garment within SETTLING
    torque    T R(h_drawn + (1 - stored / 2) migration T_s)

The wire lifts the routers by dh against the garment and does the work T (dl/dh) dh. With stored = 1 the garment keeps
all of it as an elastic body does: stroke and torque then derive from one co-energy W(T, q), dW/dT = s and dW/dq = tau,
so that no closed cycle gains energy (Maxwell: ds/dq at constant T is dtau/dT at constant q). With stored = 0 the torque
has the arm of the lifted path, as of a router that a loss-free drive moves. An instant h(T) would close an algebraic
loop of gain above 1 (more tension, more height, less tension).
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.relaxation import relaxed

SETTLING = 0.01  # time in which the garment follows the tension [s]; assumed
TAUT = 15.0  # tension above which the garment is taut and lifts no further [N]; beyond all references; assumed


def worn_height(height, tension, migration, stored, felt):
    """Router height under the wire [m]."""
    return height + migration * felt


def lever_height(height, migration, stored, felt):
    """Router height with which the wire turns the joints [m]: R is linear in h: half the lift is its mean."""
    return height - 0.5 * stored * migration * felt


def settle(dt, stretched, tension, tension_finger, travel, migration, stored, felt):
    """Tension that the garment has relaxed under [N]."""
    return relaxed(felt, min(tension_finger, TAUT), dt, SETTLING)


EFFECT = Effect(
    id="finger.router_migration",
    summary="garment deforms: router height changes with tension",
    signature="moment arm depends on tension at the same angle; extra stroke grows with tension and flexion",
    source="physics.md 4.D; 0.05-0.3 mm/N",
    at={
        "wire_paths.worn_height": worn_height,
        "wire_paths.lever_height": lever_height,
        "tendon.settle": settle,
    },
    parameters=(
        EffectParameter("migration", "m/N", null=0.0, low=1e-5, high=3e-4, axis=TENDONS, default=1e-4),
        EffectParameter("stored", "-", null=1.0, low=0.0, high=1.0, default=1.0),
    ),
    states=(State("felt", TENDONS, unit="N"),),
    advances=("tendon.settle",),
    family="geometry",
    order=410,
)
