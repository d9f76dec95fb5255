"""Drive's speed loop slower than nominal, by weaker gains, by a filter on its command, or by both.

i = Kp factor^(1 - share) e + Ki factor^(order (1 - share)) integral e          e: speed error
T v' = v_ref - v          T = share (1 / factor - 1) T0          T0 = J / (Kp kM)

T0 is that of the robot's own motor and drive. The closed loop's bandwidth is about factor / T0 either way. order 1:
both gains fall alike; 2: the damping stays.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS


def follow(dt, speed, loop_time, factor, share, order, filtered):
    """Command after the filter [m/s], by backward Euler: its mean delay is T, however short against a tick."""
    delay = share * (1.0 / factor - 1.0) * loop_time
    return filtered + (speed - filtered) * dt / (dt + delay)


def command(speed, tension, factor, share, order, filtered):
    """Speed that the drive follows [m/s]."""
    return filtered


def loop_gain(gain, factor, share, order, filtered):
    """Factor on the proportional gain [-]."""
    return gain * factor ** (1.0 - share)


def integral_gain(gain, factor, share, order, filtered):
    """Factor on the integral gain [-]."""
    return gain * factor ** (order * (1.0 - share))


EFFECT = Effect(
    id="motor.slow_velocity_loop",
    summary="drive's speed loop slower than nominal",
    signature="stroke lags the speed command, the more the faster; symmetric in direction, independent of load",
    source="physics.md 4.A; lag 5-50 ms [A] against 10 ms nominal",
    at={
        "motor.follow": follow,
        "motor.command": command,
        "motor.loop_gain": loop_gain,
        "motor.integral_gain": integral_gain,
    },
    parameters=(
        EffectParameter("factor", "-", null=1.0, low=0.15, high=0.9, axis=TENDONS, default=0.4, transform="log"),
        EffectParameter("share", "-", null=0.0, low=0.0, high=1.0, default=0.0),
        EffectParameter("order", "-", null=1.0, low=0.0, high=2.0, default=1.0),
    ),
    states=(State("filtered", TENDONS, unit="m/s"),),
    advances=("motor.follow",),
    family="lag",
    order=105,
)
