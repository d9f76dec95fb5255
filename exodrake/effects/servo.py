"""Servos: ideal ones and their cables (`joint.*`), then those with motor, gear and supply (`servo.*`)."""

from math import cos, exp, inf

from exodrake.effects.friction import bend_bristle, brake_by_load, turn_bristle
from exodrake.effects.signal import clip, mix, scale, shift, take_up_play
from exodrake.model.effect import Effect, per_joint
from exodrake.model.part import JOINTS, State
from exodrake.physics.arithmetic import GRAVITY, brake_dry

STRANDS = 3.0
LEFT = 0.2  # of a load's inertia: assumed, as of `servo.load_inertia`


def lose_in_bends(aim, setting, loss):
    """Angle aimed at [rad]: a compliant cable passes on less of the command, the more so the more its sheath is bent.

    aim = command exp(-loss bend)          bend: the setting of the joint [rad]
    """
    return aim * exp(-loss * setting)


def add_deflection(angle, share, reach, deflection):
    """Angle at the joint [rad], which the cables that pass it drag along until they slip.

    shown_j = angle_j + d          d <- min(max(d + share (change of the neighbour's aim), -reach), reach)
    """
    return angle + deflection


def drag_along(dt, moved, share, reach, deflection):
    """Deflection [rad] after the aim of a neighbour moved [rad]."""
    return clip(deflection + share * moved, reach)


def sag_level(aim, sag):
    """Angle aimed at [rad] by a servo that holds a weight by an angle error times its stiffness.

    aim = command + sag cos(command)          sag: weight's torque of the level link over the servo's stiffness
    """
    return aim + sag * cos(aim)


def lag_behind(aim, before, dt, time_constant):
    """Angle after a tick [rad] behind a first-order lag, exact over a tick.

    time_constant angle' = aim - angle
    """
    return before + (aim - before) * (1.0 - exp(-dt / time_constant)) if time_constant > 0.0 else aim


def limit_speed(aim, before, dt, speed):
    """Angle after a tick [rad] of a drive that turns no faster than a speed [rad/s].

    angle <- angle + min(max(aim - angle, -speed dt), speed dt)
    """
    return before + clip(aim - before, speed * dt)


def stop_short(angle, error, width, bristle):
    """Angle at the joint [rad] that dry friction in the gear holds back, on the side that it came from.

    shown = angle - error z          z: bristle [-1 .. 1], which turns with the aim
    """
    return angle - error * bristle


def settle_gear_bristle(dt, moved, error, width, bristle):
    """The bristle [-1 .. 1] after the aim moved [rad]: dz/daim = (1 - z sgn(aim')) / width."""
    return bend_bristle(bristle, moved, width)


def half_width(bend, width, mu):
    """Half the play [rad] of a sheath with this total bend [rad]."""
    return width * exp(mu * bend)


def turn_strand(stop, moved, width):
    """A stop [-1 .. 1] after the drive moved on [rad]; 0 for no width."""
    return turn_bristle(stop, moved, width) if width > 0.0 else 0.0


def follow_sheath(aim, setting, width, mu, spread, first, second, third):
    """Angle after a tick [rad] behind play in a sheath: stop operators whose width grows with the sheath's bend.

    Friction holds the cable until it has stretched and lets go of it strand by strand; the joint follows the mean of
    the strands (Prandtl-Ishlinskii).

        angle = aim - mean_k(w_k z_k)               w_k = half_width (1 - spread, 1, 1 + spread)
        z_k: stop operator of range w_k, -1 .. 1    half_width = width exp(mu bend)

    bend: the setting of the joint [rad]. Capstan: the tension that friction can hold grows by exp(mu bend). With no
    spread this is play.
    """
    return aim - half_width(setting, width, mu) * (first + second + third + spread * (third - first)) / STRANDS


def settle_strands(dt, moved, setting, width, mu, spread, first, second, third):
    """The stops [-1 .. 1] of the three strands."""
    middle = half_width(setting, width, mu)
    return (
        turn_strand(first, moved, middle * (1.0 - spread)),
        turn_strand(second, moved, middle),
        turn_strand(third, moved, middle * (1.0 + spread)),
    )


def leave_small(error, width, jump):
    """Error that the firmware acts on [rad]: none within a width, beyond it the whole error, or what exceeds the width.

    e <- e - (1 - jump) width sgn(e) where |e| > width, else 0
    """
    if abs(error) <= width:
        return 0.0
    return error - (1.0 - jump) * width if error > 0.0 else error + (1.0 - jump) * width


def drop_voltage(voltage, duty, back_emf, resistance, source):
    """Voltage of a supply [V] behind the resistance of its source and leads.

    V = V_0 - source u i,  i = (u V - back_emf) / resistance          u: duty cycle
    """
    return (voltage + source * duty * back_emf / resistance) / (1.0 + source * duty * duty / resistance)


def carry(inertia, moment, lever):
    """Inertia of a load [kg m2] that is heavier by a moment of weight [N m] at a lever [m]: J + m l^2 of a mass there.

    A load that is lighter keeps `LEFT` of its inertia at least.
    """
    return max(inertia + moment * lever / GRAVITY, LEFT * inertia)


def weigh_down(largest, moment, lever):
    """Largest moment of a load's weight [N m] that is heavier by one: a mass at a lever adds m g l."""
    return largest + moment


def brake_by_shared_load(speed, mobility, load, opposed, coefficient):
    """Speed [rad/s] after dry friction acted for a tick, quadratic in what motor and load put on the gear together.

    q' after the tick = q' - sgn(q') min(|q'|, coefficient T^2 dt / J)          T = min(|tau|, tau_load against tau)
    """
    both = min(load - opposed, opposed) if opposed > 0.0 else 0.0
    return brake_dry(speed, coefficient * both * both * mobility)


BEND_LOSS = Effect(
    id="joint.bend_loss", summary="a bent sheath passes on less of the command", family="gain",
    signature="angle scales with the command by a factor that falls with the total bend",
    source="physics.md 4.B distributed elastic and friction; range assumed", at={"joint.aimed": lose_in_bends},
    parameters=(per_joint("loss", "1/rad", null=0.0, low=-0.2, high=0.2, default=0.05),),
)  # fmt: skip
COUPLING_TO_NEXT, COUPLING_TO_PREVIOUS = (
    Effect(
        id=f"joint.coupling_to_{side}", summary="cables run past another joint's axis, whose motion moves this one",
        family="crosstalk",
        signature="a joint that is commanded to rest moves in proportion to its neighbour's command, without a loop",
        source="Hwang et al., RA-L 2020: coupled wrist cables; range assumed",
        at={"joint.aimed": mix}, names={"other": argument},
        formula=f"aim_j = command_j + share command_k          k: the {side} joint along the chain",
        parameters=(per_joint("share", "-", null=0.0, low=-0.4, high=0.4, default=0.1),), same_meaning=True,
    )
    for side, argument in (("next", "ahead"), ("previous", "behind"))
)  # fmt: skip
DRAG_BY_NEXT, DRAG_BY_PREVIOUS = (
    Effect(
        id=f"joint.drag_by_{side}", summary="the cables of a neighbour drag a joint along until they slip",
        family="friction",
        signature="a joint that is commanded to rest goes to and fro between two stops as its neighbour turns round",
        source="friction of cables that pass a joint (Hwang et al., RA-L 2020); range assumed",
        at={"joint.shown": add_deflection, "joint.settle": drag_along}, advances=("joint.settle",),
        names={"moved": argument},
        parameters=(per_joint("share", "-", null=0.0, low=-1.0, high=1.0, default=0.4),
                    per_joint("reach", "rad", null=0.1, low=0.02, high=0.4, default=0.1, transform="log")),
        states=(State("deflection", JOINTS, unit="rad"),),
    )
    for side, argument in (("next", "ahead"), ("previous", "behind"))
)  # fmt: skip
GAIN = Effect(
    id="joint.gain", summary="the joint goes further or less far than commanded", family="gain",
    signature="error proportional to the command, no loop", source="pulley radii and elastic cables; range assumed",
    at={"joint.aimed": scale}, formula="aim = (1 + gain) command          gear or pulley ratio",
    parameters=(per_joint("gain", "-", null=0.0, low=-0.3, high=0.3, default=-0.1),), same_meaning=True,
)  # fmt: skip
GRAVITY_SAG = Effect(
    id="joint.gravity_sag", summary="the servo gives way under the weight that it carries", family="load",
    signature="constant error near one posture, largest with the link level; none in joints with an upright axis",
    source="proportional servos hold by their error; 1-5 deg; range assumed", at={"joint.aimed": sag_level},
    parameters=(per_joint("sag", "rad", null=0.0, low=-0.1, high=0.1, default=0.02),),
)  # fmt: skip
HYSTERESIS = Effect(
    id="joint.hysteresis", summary="dry friction in the gear: the joint stops short of its command",
    family="hysteresis",
    signature="angle against command is a loop with rounded corners, rate-free, which a small motion does not fill",
    source="friction over stiffness of a proportional servo (Rhoban/bam), 0.2-5 deg; Dahl 1968; range assumed",
    at={"joint.shown": stop_short, "joint.settle": settle_gear_bristle}, advances=("joint.settle",),
    parameters=(per_joint("error", "rad", null=0.0, low=0.002, high=0.3, default=0.02),
                per_joint("width", "rad", null=0.05, low=0.005, high=0.5, default=0.05, transform="log")),
    states=(State("bristle", JOINTS),),
)  # fmt: skip
LAG = Effect(
    id="joint.lag", summary="the drive follows as a first-order lag", family="lag",
    signature="angle behind the command, and smaller in fast motion",
    source="position loops of geared servos, 20-200 ms; range assumed", at={"joint.followed": lag_behind},
    parameters=(per_joint("time_constant", "s", null=0.0, low=0.01, high=0.3, default=0.06),),
)  # fmt: skip
OFFSET = Effect(
    id="joint.offset", summary="zero of the joint in the wrong place", family="offset",
    signature="constant error at every angle", source="homing and marker frames; range assumed",
    at={"joint.aimed": shift}, formula="aim = command + offset",
    parameters=(per_joint("offset", "rad", null=0.0, low=-0.3, high=0.3, default=0.05),), same_meaning=True,
)  # fmt: skip
PLAY = Effect(
    id="joint.play", summary="play: the joint rests until the drive has taken up the slack", family="backlash",
    signature="angle against command is a loop of constant width, rate-free, with flat pieces after each reversal",
    source="physics.md 4.A gear backlash 0.2-4 deg; cables more (Hwang et al., RA-L 2020)",
    at={"joint.followed": take_up_play}, formula="angle <- min(max(angle, aim - half_width), aim + half_width)",
    parameters=(per_joint("half_width", "rad", null=0.0, low=0.002, high=0.6, default=0.05),),
)  # fmt: skip
SPEED_LIMIT = Effect(
    id="joint.speed_limit", summary="the drive turns no faster than its supply allows", family="speed limit",
    signature="angle ramps at one slope after large steps of the command; slow motion untouched",
    source="no-load speeds of hobby servos, 1-10 rad/s, less with a low supply; range assumed",
    at={"joint.followed": limit_speed},
    parameters=(per_joint("speed", "rad/s", null=inf, low=0.1, high=2.0, default=0.5, transform="reciprocal"),),
)  # fmt: skip
SHEATH_PLAY = Effect(
    id="joint.sheath_play",
    summary="play of a cable in a sheath, which grows with the bend as friction round a capstan does",
    family="backlash",
    signature="as play with rounded corners; over configurations the width grows exponentially with the total bend",
    source="physics.md 4.B capstan, Prandtl-Ishlinskii; Nho et al., RA-L 2021",
    at={"joint.followed": follow_sheath, "joint.settle": settle_strands},
    parameters=(per_joint("width", "rad", null=0.0, low=0.02, high=1.0, default=0.3),
                per_joint("mu", "1/rad", null=0.0, low=0.0, high=0.5, default=0.1),
                per_joint("spread", "-", null=0.0, low=0.0, high=0.8, default=0.2)),
    states=(State("stops", JOINTS, 3),), advances=("joint.settle",),
)  # fmt: skip
DEAD_BAND = Effect(
    id="servo.dead_band", summary="the firmware leaves small errors alone", family="dead zone",
    signature="the joint rests up to a width from its command, on the side that it came from",
    source="dead band registers of bus servos, 1-3 counts, more of hobby servos; range assumed",
    at={"servo.firmware_error": leave_small},
    parameters=(per_joint("width", "rad", null=0.0, low=0.002, high=0.1, default=0.02),
                per_joint("jump", "-", null=0.0, low=0.0, high=1.0, default=0.0)),
)  # fmt: skip
DUTY_LIMIT = Effect(
    id="servo.duty_limit", summary="the firmware gives less than the whole supply", family="saturation",
    signature="large steps are slower and heavy loads hang lower, by one force; slow motion without a load untouched",
    source="torque and duty limits in registers of bus servos; range assumed", at={"servo.duty": clip},
    formula="u = min(max(u_0, -limit), limit)",
    parameters=(per_joint("limit", "-", null=inf, low=0.1, high=0.9, default=0.5, transform="reciprocal"),),
    same_meaning=True,
)  # fmt: skip
GEAR_COMPLIANCE = Effect(
    id="servo.gear_compliance", summary="elastic gear between motor and joint", family="elasticity",
    signature="a resonance of rotor against load, within the position loop",
    source="plastic and metal gears of small servos, 3-300 N m/rad; range assumed",
    at={"servo.gear_compliance": shift},
    formula="q_rotor - q = (c + compliance) torque of the gear",
    parameters=(per_joint("compliance", "rad/(N m)", null=0.0, low=0.003, high=0.3, default=0.03),),
)  # fmt: skip
GEAR_PLAY = Effect(
    id="servo.gear_play", summary="play of the gear between motor and joint", family="backlash",
    signature="the load rattles where its torque changes sign; at rest under weight nothing",
    source="physics.md 4.A gear backlash 0.2-4 deg; range assumed", at={"servo.gear_play": shift},
    formula="no torque where |q_rotor - q| < half_width",
    parameters=(per_joint("half_width", "rad", null=0.0, low=0.002, high=0.1, default=0.02),),
)  # fmt: skip
GRAVITY_MOMENT = Effect(
    id="servo.gravity_moment", summary="a load heavier or lighter than stated, as by a payload", family="load",
    signature="an error of posture: largest with the load level, none with it upright or hanging; slower with a lever",
    source="weight times lever; ranges assumed",
    at={"servo.load_moment": weigh_down, "servo.load_inertia": carry},
    formula="gravity = (m g l + moment) sin(q - hanging),  J_j = J + moment lever / g          a mass at a lever",
    parameters=(per_joint("moment", "N m", null=0.0, low=-1.0, high=1.0, default=0.1),
                per_joint("lever", "m", null=0.0, low=0.0, high=0.5, default=0.1)),
)  # fmt: skip
LOAD_INERTIA = Effect(
    id="servo.load_inertia", summary="inertia of the load other than stated", family="inertia",
    signature="slower and with more overshoot, or the other way round; nothing at rest",
    source="CAD without cables; range assumed", at={"servo.load_inertia": scale},
    formula="J_j = (1 + share) J",
    parameters=(per_joint("share", "-", null=0.0, low=-0.8, high=4.0, default=0.5),),
)  # fmt: skip
LOOP_GAIN = Effect(
    id="servo.loop_gain", summary="gain of the firmware other than stated", family="gain",
    signature="stiffness off: sag, dead band of friction and speed of approach change, the fastest motion does not",
    source="registers and their units; range assumed", at={"servo.firmware_gain": scale},
    formula="kp_j = (1 + share) kp",
    parameters=(per_joint("share", "-", null=0.0, low=-0.7, high=2.0, default=-0.3),), same_meaning=True,
)  # fmt: skip
SUPPLY = Effect(
    id="servo.supply", summary="voltage of the supply other than stated", family="supply",
    signature="fastest motion and stiffness off by the same share", source="batteries, 6-8.4 V; range assumed",
    at={"servo.supply_voltage": scale}, formula="V = (1 + share) V_0",
    parameters=(per_joint("share", "-", null=0.0, low=-0.6, high=0.6, default=-0.2),), same_meaning=True,
)  # fmt: skip
SUPPLY_SAG = Effect(
    id="servo.supply_sag", summary="the supply gives way under current", family="supply",
    signature="slower start and less torque at stall, the fastest motion is nearly as stated",
    source="leads, connectors and batteries 0.05-2 V/A; range assumed", at={"servo.supply_voltage": drop_voltage},
    parameters=(per_joint("source", "V/A", null=0.0, low=0.05, high=3.0, default=0.5),),
)  # fmt: skip
TORQUE_CONSTANT = Effect(
    id="servo.torque_constant", summary="torque constant of the motor other than stated", family="gain",
    signature="torque and fastest motion off, one up and the other down", source="hot magnets, data sheets; assumed",
    at={"servo.torque_constant": scale}, formula="kt_j = (1 + share) kt",
    parameters=(per_joint("share", "-", null=0.0, low=-0.5, high=0.5, default=-0.15),), same_meaning=True,
)  # fmt: skip
BACKDRIVING_FRICTION = Effect(
    id="servo.backdriving_friction", summary="dry friction proportional to the torque of the load", family="friction",
    signature="a load holds itself: as dry friction, in proportion to the weight at this posture",
    source="Duclusaud et al., ICRA 2025 (Rhoban/bam M5: load_friction_external 0.0-0.5)",
    at={"servo.braked": brake_by_load}, names={"load": "opposed"},
    formula="q' after the tick = q' - sgn(q') min(|q'|, coefficient |tau_load| dt / J)",
    parameters=(per_joint("coefficient", "-", null=0.0, low=0.02, high=0.8, default=0.25),),
)  # fmt: skip
QUADRATIC_FRICTION = Effect(
    id="servo.quadratic_friction", summary="dry friction quadratic in the load that motor and weight share",
    family="friction", signature="as dry friction, but only under load against the motor, and far more under twice it",
    source="Duclusaud et al., ICRA 2025 (Rhoban/bam M6); range assumed", at={"servo.braked": brake_by_shared_load},
    parameters=(per_joint("coefficient", "1/(N m)", null=0.0, low=0.05, high=5.0, default=0.5),),
)  # fmt: skip
