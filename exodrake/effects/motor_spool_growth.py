"""Spool radius grows as wire winds up; the encoder still counts with the nominal one.

r(s) = r (1 + growth s)          s = spool (1 + growth spool / 2)          torque = r(s) T
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def wound(spool, growth):
    """Wire on the spool [m], from r theta [m]."""
    return spool * (1.0 + 0.5 * growth * spool)


def winding(speed, spool, growth):
    """Speed of the wire [m/s], from r theta'."""
    return speed * (1.0 + growth * spool)


def load(tension, spool, growth):
    """Tension felt at the nominal radius [N]."""
    return tension * (1.0 + growth * spool)


EFFECT = Effect(
    id="motor.spool_growth",
    summary="spool radius grows as wire winds up",
    signature="stroke reads short by a term that grows with the square of the winding, in both directions alike",
    source="physics.md 4.A; 3-7 % per layer, a layer a turn (47 mm) or a few",
    at={"motor.wound": wound, "motor.winding": winding, "motor.load": load},
    parameters=(EffectParameter("growth", "1/m", null=0.0, low=0.2, high=6.0, axis=TENDONS, default=2.0),),
    family="geometry",
    order=135,
)
