"""Drive's speed loop slower than nominal: both gains scaled.

i = factor (Kp e + Ki integral e)          closed-loop bandwidth about factor Kp kM / J
"""

from exodrake.block import WIRES, Effect, Number


def loop_gain(gain, factor):
    """Factor on both gains [-]."""
    return gain * factor


EFFECT = Effect(
    id="motor.slow_velocity_loop",
    summary="drive's speed loop slower than nominal",
    signature="stroke lags the speed command, the more the faster; symmetric in direction, independent of load",
    source="physics.md 4.A; lag 5-50 ms [A] against 10 ms nominal",
    at={"motor.loop_gain": loop_gain},
    numbers=(Number("factor", "-", neutral=1.0, low=0.15, high=0.9, over=WIRES, usual=0.4, scale="log"),),
)
