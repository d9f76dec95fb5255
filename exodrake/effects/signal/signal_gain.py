"""Scale error of a reading.

shown = (1 + gain) value
"""

from exodrake.core.effect import Effect, EffectParameter


def shown(value, clock, period, gain):
    """Value as shown."""
    return (1.0 + gain) * value


EFFECT = Effect(
    id="signal.gain",
    summary="scale error of the reading",
    signature="reading off in proportion to its value, without a loop",
    source="calibration of a sensor, 1-20 %; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("gain", "-", null=0.0, low=-0.3, high=0.3, default=-0.1),),
    family="gain",
    same_meaning=True,
    order=740,
)
