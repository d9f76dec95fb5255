"""Mass that an arm holds at its tip.

m_tip = m + mass
"""

from exodrake.core.effect import Effect, EffectParameter


def carried(payload, mass):
    """Mass at the tip [kg]."""
    return payload + mass


EFFECT = Effect(
    id="arm.payload",
    summary="a mass at the tip",
    signature="efforts of gravity and acceleration as of a mass at the tip, largest at the base's joints",
    source="Newton's law; range assumed: what arms of some 10 kg hold",
    at={"arm.carried": carried},
    parameters=(EffectParameter("mass", "kg", null=0.0, low=0.02, high=5.0, default=0.5),),
    family="inertia",
)
