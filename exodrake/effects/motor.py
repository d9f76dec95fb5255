"""Motor and spool: the drive's loops and limits, friction of rotor and gear, the wire on the spool."""

from math import copysign, floor, inf

from exodrake.effects.friction import bend_bristle, find_stiffness, slip_spring
from exodrake.model.effect import Effect, EffectParameter, per_tendon
from exodrake.model.part import TENDONS, State

HARD = 0.01  # knee below which the current is clipped [-]
NONE = 1e-3  # share of the limit below which the knee does not show [-]
WIDTH = 1.0  # rotor angle over which the rotor's friction turns round [rad]; assumed
PRESLIDING = 2e-4  # wire over which the gear's losses turn round at `friction.LOAD` [m], two rotor radians; assumed


def filter_command(dt, speed, loop_time, factor, share, order, filtered):
    """Command after the filter [m/s], by backward Euler: its mean delay is T, however short against a tick.

        i = Kp factor^(1 - share) e + Ki factor^(order (1 - share)) integral e          e: speed error
        T v' = v_ref - v          T = share (1 / factor - 1) T0          T0 = J / (Kp kM)

    The loop is slower by weaker gains, by a filter on its command, or by both; its bandwidth is about factor / T0
    either way, with T0 of the robot's own motor and drive. order 1: both gains fall alike; 2: the damping stays.
    """
    delay = share * (1.0 / factor - 1.0) * loop_time
    return filtered + (speed - filtered) * dt / (dt + delay)


def filtered_command(speed, factor, share, order, filtered):
    """Speed that the drive follows [m/s]."""
    return filtered


def loop_gain(gain, factor, share, order, filtered):
    """Factor on the proportional gain [-]."""
    return gain * factor ** (1.0 - share)


def integral_gain(gain, factor, share, order, filtered):
    """Factor on the integral gain [-]."""
    return gain * factor ** (order * (1.0 - share))


def release_drive(dt, speed, width, release, moving):
    """1 while the drive moves, else 0: it ignores small speed commands.

        v = v_ref from where |v_ref| exceeds width, until |v_ref| falls below release width; 0 else

    What makes a drive stand still, static friction or a threshold, lets go of it at a smaller command than it takes to
    start.
    """
    threshold = width * release if moving > 0.5 else width
    return 0.0 if abs(speed) < threshold else 1.0


def moving_command(speed, width, release, moving):
    """Speed that the drive follows [m/s]."""
    return speed * moving


def limit_by_load(speed, tension, limit, coefficient):
    """Speed [m/s] that the supply allows, which falls with load; a load that pulls the wire out helps it.

    -(limit + coefficient T_c) <= v <= max(0, limit - coefficient T_c)          v > 0 while the spool takes wire in
    """
    drop = coefficient * tension
    return min(max(speed, -limit - drop), max(limit - drop, 0.0))


def current_limit(nominal, limit, knee):
    """Current at which the drive clips [A], with a knee.

    i = u / (1 + |u / limit|^(1 / knee))^knee        u = Kp e + z        knee -> 0: i = clip(u, -limit, +limit)
    """
    return min(nominal, limit)


def current(clipped, wanted, nominal, limit, knee):
    """Current that flows [A]."""
    used = abs(wanted) / limit
    if knee <= HARD or used < NONE:
        return clipped
    return copysign(min(nominal, limit / (1.0 + used ** (-1.0 / knee)) ** knee), wanted)


def drag(load, torque, bristle):
    """Torque on the rotor [N m] with dry friction, z over WIDTH of its angle: r T_c / N + torque z."""
    return load + torque * bristle


def settle_rotor(dt, rotor_speed, torque, bristle):
    """Bristle [-1 .. 1]."""
    return bend_bristle(bristle, rotor_speed * dt, WIDTH)


def lose_in_gear(tension, spool, efficiency, force, spool_before):
    """Tension that the rotor feels [N], then the force of the losses [N] and the spool it has seen [m].

        felt = T_c + F          T_c (efficiency - 1) <= F <= T_c (1 / efficiency - 1)      F of `friction.slip_spring`

    The rotor feels more when it winds, felt = T_c / efficiency, less when it is driven back, felt = T_c efficiency.
    """
    low, high = tension * (efficiency - 1.0), tension * (1.0 / efficiency - 1.0)
    after = slip_spring(force, spool - spool_before, find_stiffness(1.0 / efficiency - 1.0, PRESLIDING), low, high)
    return tension + after, after, spool


def wind_on_growing(spool, growth):
    """Wire on a spool that grows [m], from r theta [m], with which the encoder still counts.

    r(s) = r (1 + growth s)          s = spool (1 + growth spool / 2)          torque = r(s) T
    """
    return spool * (1.0 + 0.5 * growth * spool)


def grow_radius(value, spool, growth):
    """Speed of the wire [m/s] from r theta', or tension felt at the nominal radius [N]."""
    return value * (1.0 + growth * spool)


def count_layers(spool, pitch):
    """Full layers on the spool [-]."""
    return max(floor(spool / pitch), 0.0)


def wind_in_layers(spool, growth, pitch):
    """Wire on a spool whose radius each full layer raises by a step [m], from r theta [m].

    r = r0 (1 + growth m)        s = spool + growth (m spool - pitch m (m + 1) / 2)        m = floor(spool / pitch) >= 0
    """
    full = count_layers(spool, pitch)
    return spool + growth * full * (spool - 0.5 * pitch * (full + 1.0))


def grow_by_layers(value, spool, growth, pitch):
    """Speed of the wire [m/s] from r theta', or tension felt at the nominal radius [N]."""
    return value * (1.0 + growth * count_layers(spool, pitch))


SLOW_VELOCITY_LOOP = Effect(
    id="motor.slow_velocity_loop", summary="drive's speed loop slower than nominal", family="lag",
    signature="stroke lags the speed command, the more the faster; symmetric in direction, independent of load",
    source="physics.md 4.A; lag 5-50 ms [A] against 10 ms nominal",
    at={"motor.follow": filter_command, "motor.command": filtered_command,
        "motor.loop_gain": loop_gain, "motor.integral_gain": integral_gain},
    parameters=(per_tendon("factor", "-", null=1.0, low=0.15, high=0.9, default=0.4, transform="log"),
                EffectParameter("share", "-", null=0.0, low=0.0, high=1.0, default=0.0),
                EffectParameter("order", "-", null=1.0, low=0.0, high=2.0, default=1.0)),
    states=(State("filtered", TENDONS, unit="m/s"),), advances=("motor.follow",),
)  # fmt: skip
DEAD_ZONE = Effect(
    id="motor.dead_zone", summary="drive ignores small speed commands", family="dead zone",
    signature="tension stays off its reference by up to width over kp; no motion below the threshold, limit cycles",
    source="physics.md 4.A; 0-2 mm/s [A]; release: 4.B, static over sliding friction 1-1.5",
    at={"motor.follow": release_drive, "motor.command": moving_command},
    parameters=(per_tendon("width", "m/s", null=0.0, low=2e-4, high=4e-3, default=1e-3),
                per_tendon("release", "-", null=1.0, low=0.5, high=1.0, default=0.8)),
    states=(State("moving", TENDONS),), advances=("motor.follow",),
)  # fmt: skip
SPEED_DROOP = Effect(
    id="motor.speed_droop",
    summary="supply limits the speed: the less of it is left to pull, the more to let out, the higher the load",
    family="saturation",
    signature="stroke rate levels off in large steps, under load at a lower level inwards; slow motion untouched",
    source="physics.md 4.A; 70-150 mm/s no-load, stall at 42 N gives 2-3 mm/s per N; above 50 mm/s it hardly shows",
    at={"motor.command": limit_by_load},
    parameters=(per_tendon("limit", "m/s", null=inf, low=0.005, high=0.05, default=0.03, transform="reciprocal"),
                per_tendon("coefficient", "m/(s N)", null=0.0, low=0.0, high=0.005, default=0.002)),
    not_tried="rare: a drive this far below its no-load speed hardly droops; motor.current_limit is tried",
)  # fmt: skip
CURRENT_LIMIT = Effect(
    id="motor.current_limit", summary="current is limited lower than nominal", family="saturation",
    signature="tension levels off and speed falls short where load or acceleration is high",
    source="physics.md 4.A; 0.11 A holds 12 N at the wire, above 0.12 A nothing clips; knee assumed",
    at={"motor.current_limit": current_limit, "motor.current": current},
    parameters=(per_tendon("limit", "A", null=inf, low=0.02, high=0.12, default=0.06, transform="reciprocal"),
                per_tendon("knee", "-", null=0.2, low=0.02, high=0.5, default=0.2, transform="log")),
)  # fmt: skip
FRICTION = Effect(
    id="motor.friction", summary="dry friction at the rotor", family="friction",
    signature="stroke sticks and slips against the speed command near standstill, whatever the load",
    source="physics.md 3.1; 0.08 mN m [S:F1524], 0.74 N at the wire",
    at={"motor.drag": drag, "motor.settle": settle_rotor},
    parameters=(per_tendon("torque", "N m", null=0.0, low=2e-5, high=1e-3, default=3e-4),),
    states=(State("bristle", TENDONS),), advances=("motor.settle",),
    not_tried="the drive's speed loop hides it from stroke and tension; motor.dead_zone is tried",
)  # fmt: skip
GEAR_EFFICIENCY = Effect(
    id="motor.gear_efficiency", summary="gear losses proportional to load", family="friction",
    signature="speed error against the command jumps with direction under load; the finger's loops untouched",
    source="physics.md 3.1, 4.A; 0.5-0.85 [S:FFAQ]", at={"motor.load": lose_in_gear},
    parameters=(per_tendon("efficiency", "-", null=1.0, low=0.4, high=0.95, default=0.65),),
    states=(State("force", TENDONS, unit="N"), State("spool_before", TENDONS, unit="m")), filters=("motor.load",),
    not_tried="the drive's speed loop hides it until the current clips; motor.current_limit is tried",
)  # fmt: skip
SPOOL_GROWTH = Effect(
    id="motor.spool_growth", summary="spool radius grows as wire winds up", family="geometry",
    signature="stroke reads short by a term that grows with the square of the winding, in both directions alike",
    source="physics.md 4.A; 3-7 % per layer, a layer a turn (47 mm) or a few",
    at={"motor.wound": wind_on_growing, "motor.winding": grow_radius, "motor.load": grow_radius},
    parameters=(per_tendon("growth", "1/m", null=0.0, low=0.2, high=6.0, default=2.0),),
)  # fmt: skip
SPOOL_LAYERS = Effect(
    id="motor.spool_layers", summary="each full layer of wire raises the spool's radius by a step", family="geometry",
    signature="slope of true against counted stroke steps up where a layer is full, in both directions alike",
    source="physics.md 4.A; 3-7 % per layer; a finger takes in 22 mm at most",
    at={"motor.wound": wind_in_layers, "motor.winding": grow_by_layers, "motor.load": grow_by_layers},
    parameters=(per_tendon("growth", "-", null=0.0, low=0.01, high=0.15, default=0.06),
                per_tendon("pitch", "m", null=0.008, low=0.003, high=0.012, default=0.008, transform="log")),
    not_tried="another law of motor.spool_growth, which is tried",
)  # fmt: skip
