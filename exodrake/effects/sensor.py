"""The load cells: what the sensing pulley, the cell and its amplifier do to a reading of tension."""

from math import exp, pi

from exodrake.effects.friction import find_stiffness, settle_bristle, slip_spring
from exodrake.effects.signal import drift, mix, relax, scale, shift
from exodrake.model.effect import ANY_SHAPE, Effect, per_tendon
from exodrake.model.part import TENDONS, State
from exodrake.physics.sensor import lag_ramp

FULL_SCALE = 20.0  # tension at which the cell is full [N]: assumed


def rub_pulley(tension, travel, mu, presliding, force):
    """Force of friction at the sensing pulley [N] after the spool took in a further travel [m]."""
    low, high = tension * (exp(-mu * pi) - 1.0), tension * (exp(mu * pi) - 1.0)
    return slip_spring(force, travel, find_stiffness(mu * pi, presliding), low, high)


def pull_at_spool(tension, mu, presliding, force, stretch_before):
    """Tension at the spool [N]: the wire turns round the sensing pulley by pi, and the motor does friction's work.

        T_spool = T + F          T (exp(-mu pi) - 1) <= F <= T (exp(mu pi) - 1)          F of `friction.slip_spring`
        reading = (T_spool + T) / 2

    T is the tension of the wire beyond the pulley. While the spool takes wire in T_spool = T exp(mu pi), while it gives
    wire back T_spool = T exp(-mu pi): the finger gets less than the reading says, then more.
    """
    return tension + rub_pulley(tension, 0.0, mu, presliding, force)


def average_strands(tension, mu, presliding, force, stretch_before):
    """Load on the cell, as tension [N]: the mean of both strands."""
    return tension + 0.5 * rub_pulley(tension, 0.0, mu, presliding, force)


def settle_pulley(dt, stretched, tension, travel, mu, presliding, force, stretch_before):
    """Force of friction [N] after the wire at the spool moved, and the stretch it has seen [m]."""
    return rub_pulley(tension, travel + stretched - stretch_before, mu, presliding, force), stretched


def lag(nominal, time_constant, filtering, filtered, amplified, tick):
    """Time constant of the amplifier [s].

        (1 - filtering) time_constant a' = T - a          filtering time_constant F' = a - F

    An amplifier is followed by the filter of its converter, which may be slow as well; both lag by `time_constant`. The
    second stage is exact for an amplified tension that is linear over a tick, as the first is, so that `filtering` may
    fall to 0 without a jump.
    """
    return max(nominal, (1.0 - filtering) * time_constant)


def filtered_reading(tension, time_constant, filtering, filtered, amplified, tick):
    """Filtered tension of this instant [N]: a tick after that of the states."""
    return lag_ramp(filtered, amplified, tension, tick, filtering * time_constant) if tick > 0.0 else tension


def settle_filter(dt, cell, time_constant, filtering, filtered, amplified, tick):
    """Filtered and amplified tension [N] at the end of a tick [s]."""
    return lag_ramp(filtered, amplified, cell, dt, filtering * time_constant), cell, dt


def crept_reading(tension, fraction, time_constant, crept):
    """Tension as read [N] of a standard linear solid: F = T + y; time_constant y' = fraction T - y."""
    return tension + crept


def settle_creep(dt, load, fraction, time_constant, crept):
    """Reading by creep [N]."""
    return relax(crept, fraction * load, dt, time_constant)


def hysteretic_reading(tension, error, width, bristle, load_before):
    """Tension as read [N] that remembers its way: F = T + error z; z: bristle over a width of load."""
    return tension + error * bristle


def bend_reading(tension, error):
    """Tension as read [N] with a parabolic error: F = T + error T (T_s - T) / (T_s / 2)^2; T_s = 20 N full scale."""
    half = 0.5 * FULL_SCALE
    return tension + error * tension * (FULL_SCALE - tension) / (half * half)


PULLEY_FRICTION = Effect(
    id="sensor.pulley_friction", summary="friction at the sensing pulley: the reading depends on direction",
    family="friction",
    signature="the finger gets less than the reading says while the spool pulls and more while it gives; rate-free",
    source="physics.md 4.C; capstan equation over half a turn, 1-5 %; presliding travel assumed",
    at={"tendon.at_spool": pull_at_spool, "tendon.at_cell": average_strands, "tendon.settle": settle_pulley},
    parameters=(per_tendon("mu", "-", null=0.0, low=0.003, high=0.15, default=0.04),
                per_tendon("presliding", "m", null=5e-5, low=1e-5, high=2e-3, default=5e-5, transform="log")),
    states=(State("force", TENDONS, unit="N"), State("stretch_before", TENDONS, unit="m")), advances=("tendon.settle",),
    law_std=ANY_SHAPE,
)  # fmt: skip
CROSSTALK = Effect(
    id="sensor.crosstalk", summary="a cell picks up the next wire's load", family="crosstalk",
    signature="reading error proportional to the tension of another wire", source="physics.md 4.C; 0.1-2 %",
    at={"sensor.mixed": mix},
    formula="F_j = T_j + coefficient T_(j+1)          the last wire is followed by the first",
    parameters=(per_tendon("coefficient", "-", null=0.0, low=-0.15, high=0.15, default=0.03),), same_meaning=True,
)  # fmt: skip
LAG = Effect(
    id="sensor.lag", summary="slower filter than nominal in the load cell's amplifier", family="lag",
    signature="reading lags in ramps and rounds off steps, alike in both directions; nothing at rest",
    source="physics.md 4.C; 2-50 ms; share of the converter's filter assumed",
    at={"sensor.lag": lag, "sensor.reading": filtered_reading, "sensor.settle": settle_filter},
    parameters=(per_tendon("time_constant", "s", null=0.0, low=0.003, high=0.1, default=0.02),
                per_tendon("filtering", "-", null=0.2, low=0.02, high=0.5, default=0.2)),
    states=(State("filtered", TENDONS, unit="N"), State("amplified", TENDONS, unit="N"),
            State("tick", TENDONS, unit="s")),
    advances=("sensor.settle",),
)  # fmt: skip
CREEP = Effect(
    id="sensor.creep", summary="the cell goes on yielding under load", family="viscoelasticity",
    signature="reading drifts towards load at held tension and comes back late; stroke and angle tell otherwise",
    source="physics.md 4.C; 0.1 % in 30 min for a good cell, per cent for a printed one",
    at={"sensor.reading": crept_reading, "sensor.settle": settle_creep},
    parameters=(per_tendon("fraction", "-", null=0.0, low=0.005, high=0.15, default=0.05),
                per_tendon("time_constant", "s", null=10.0, low=1.0, high=100.0, default=10.0, transform="log")),
    states=(State("crept", TENDONS, unit="N"),), advances=("sensor.settle",), law_std=ANY_SHAPE,
    not_tried="another law of a slow zero error; sensor.drift is tried",
)  # fmt: skip
HYSTERESIS = Effect(
    id="sensor.hysteresis", summary="the cell remembers the way its load has come", family="hysteresis",
    signature="reading differs between rising and falling tension by an amount independent of stroke and rate",
    source="physics.md 4.C; 0.05-0.2 % of full scale, more for a cheap cell",
    at={"sensor.reading": hysteretic_reading, "sensor.settle": settle_bristle}, names={"value": "load"},
    parameters=(per_tendon("error", "N", null=0.0, low=-0.5, high=0.5, default=0.1),
                per_tendon("width", "N", null=1.0, low=0.2, high=5.0, default=1.0, transform="log")),
    states=(State("bristle", TENDONS), State("load_before", TENDONS, unit="N")), advances=("sensor.settle",),
    not_tried="another law of a direction-dependent reading; sensor.pulley_friction is tried",
)  # fmt: skip
NONLINEARITY = Effect(
    id="sensor.nonlinearity", summary="parabolic error of the load cell, zero at 0 and full scale (20 N)",
    family="nonlinearity", signature="reading error curved over tension, greatest at mid range, without a loop",
    source="physics.md 4.C; 0.1 N at mid range", at={"sensor.reading": bend_reading},
    parameters=(per_tendon("error", "N", null=0.0, low=-1.0, high=1.0, default=0.2),), law_std=ANY_SHAPE,
)  # fmt: skip
GAIN = Effect(
    id="sensor.gain", summary="scale error of the load cell", family="gain",
    signature="reading off in proportion to tension, without a loop", source="physics.md 4.C; 1-5 %",
    at={"sensor.reading": scale}, formula="F = (1 + gain) T",
    parameters=(per_tendon("gain", "-", null=0.0, low=-0.2, high=0.2, default=0.05),), same_meaning=True,
)  # fmt: skip
OFFSET = Effect(
    id="sensor.offset", summary="zero error of the load cell", family="offset",
    signature="reading off by the same amount at every tension, a slack wire included",
    source="physics.md 4.C; 0.05-0.5 N", at={"sensor.reading": shift}, formula="F = T + offset",
    parameters=(per_tendon("offset", "N", null=0.0, low=-1.5, high=1.5, default=0.2),), same_meaning=True,
)  # fmt: skip
DRIFT = Effect(
    id="sensor.drift", summary="zero of the load cell wanders with time", family="drift",
    signature="reading error grows with time, not with tension or stroke",
    source="physics.md 4.C; temperature and creep, 0.05 % of full scale per 10 K", at={"sensor.reading": drift},
    formula="F = T + rate t          t from the start of the log",
    parameters=(per_tendon("rate", "N/s", null=0.0, low=-0.03, high=0.03, default=0.005),), law_std=ANY_SHAPE,
)  # fmt: skip
