"""Forms of the laws that may be missing: for each point of a part, the variables that act there.

A form adds `factor f(variable)` to the value that passes the point, with a free curve f, or a sum of elements that
remember how the variable moved. Texts are source code in the point's own arguments. Points without an entry here, such
as those of a user's machine, get one curve for each of their arguments.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import dataclass, replace

from exodrake.core.machine import Machine
from exodrake.core.part import Part, Point, module_name

CURVE, PLACE, HYSTERESIS, RELAXATION = "curve", "place", "hysteresis", "relaxation"
REMEMBERS = (PLACE, HYSTERESIS, RELAXATION)


@dataclass(frozen=True)
class Form:
    """One free law at a point.

    Attributes:
        words: what the curve gives, over what: "friction over speed".
        variable: u, as source of the point's arguments; of a law with memory, of those of the point `advances`.
        unit: of u.
        factor: what multiplies f(u), as source; "" for 1.
        kind: curve of u, of the place that the moves of u add up to, or memory: hysteresis or relaxation.
        advances: name of the point at which the states of a law with memory advance.
        moves: whether the variable of a law with memory is already a change within the tick.
        fine: whether knots lie close together near 0, where the law may jump.
        result: how the law acts on the value, with `law` for the sum of factor and curve; "" for value + law.
        rate: point that takes the rate of this value, and its result there, with `slope` for f'(u).
    """

    words: str
    variable: str
    unit: str
    factor: str = ""
    kind: str = CURVE
    advances: str = ""
    moves: bool = False
    fine: bool = False
    result: str = ""
    rate: tuple[str, str, str] = ("", "", "")


def curve(words: str, variable: str, unit: str, factor: str = "", fine: bool = False, result: str = "") -> Form:
    """A free curve of a variable."""
    return Form(words, variable, unit, factor, fine=fine, result=result)


def memory(words: str, variable: str, unit: str, advances: str, factor: str = "", moves: bool = False) -> list[Form]:
    """Hysteresis and relaxation of a variable."""
    kinds = ((HYSTERESIS, "hysteresis"), (RELAXATION, "relaxation"))
    return [Form(f"{name} {words}", variable, unit, factor, kind, advances, moves) for kind, name in kinds]


BRAKED = "dragged(speed, law * mobility)"  # dry friction never turns a stop into a push
GRIP = "-min(1.0, tension / 0.1)"  # friction fades as the wire goes slack, as in effects.friction.grip
AGAINST = "rate / (abs(rate) + 0.05)"  # direction of a joint, blurred over a slow turn [rad/s]: assumed
VALUE = "{value}"  # the point's own value, whose name differs between the parts of a family: force, effort
SLIDING = {
    "sliding.pushed": [
        curve("force over speed", "speed", "m/s", "-1.0", fine=True),
        Form("force over place", "travel", "m", "-1.0", PLACE, "settle", moves=True),
        Form("gain over place", "travel", "m", VALUE, PLACE, "settle", moves=True),
        *memory("of force over place", "travel", "m", "settle", "-1.0", moves=True),
    ],
    "sliding.braked": [
        curve("dry friction over speed", "abs(speed)", "m/s", fine=True, result=BRAKED),
        curve("dry friction over load", "load", "N", result=BRAKED),
        Form("dry friction over place", "travel", "m", "", PLACE, "settle", moves=True, result=BRAKED),
    ],
}
SIGNAL = {
    "signal.shown": [
        curve("error of the reading over its value", "value", ""),
        curve("error of the reading over time", "clock", "s"),
        *memory("of the reading", "value", "", "shown"),
    ]
}
TENDON = {
    "tendon.transmit": [
        curve("friction over tension", "tension", "N", "-slide"),
        curve("friction over speed", "speed", "m/s", GRIP, fine=True),
        *memory("of friction over travel", "travel", "m", "settle", GRIP, moves=True),
    ],
    "tendon.elastic": [
        curve("tension over stretch", "stretch", "m"),
        *memory("of tension", "stretched", "m", "settle"),
    ],
    "tendon.stretch": [
        curve("lengthening over tension", "tension_finger", "N", "-1.0"),
        *memory("of length over tension", "tension", "N", "settle"),
    ],
}
MOTOR = {
    "motor.command": [
        curve("speed over its command", "speed", "m/s", fine=True),
        curve("loss of speed over tension", "tension", "N", "-1.0"),
        *memory("of speed over its command", "speed", "m/s", "follow"),
    ],
    "motor.load": [
        curve("load over tension", "tension", "N"),
        curve("radius for the load over wire wound", "spool", "m", "tension"),
    ],
    "motor.wound": [
        Form(
            "wire wound over spool angle", "stroke", "m",
            rate=("winding", "spool", "speed * (1.0 + slope)"),
        )
    ],
}  # fmt: skip
SENSORS = {
    "sensor.felt": [curve("friction at the cell over tension", "tension", "N", "-slide")],
    "sensor.reading": [
        curve("error of the reading over tension", "tension", "N"),
        curve("error of the reading over time", "clock", "s"),
        *memory("of the reading", "load", "N", "settle"),
    ],
    "encoder.homed": [curve("error of the reading over stroke", "stroke", "m")],
    "mocap.seen": [curve("error of the reading over angle", "angle", "rad")],
    "mocap.late": [curve("delay over time", "clock", "s")],
}
FINGER = {
    "finger.passive": [
        curve("torque over bend", "bend", "rad"),
        curve("torque over rate", "rate", "rad/s", fine=True),
        curve("friction over bend", "bend", "rad", AGAINST),
        curve("torque over time", "clock", "s"),
        curve("stiffness over time", "clock", "s", "elastic"),
        *memory("of torque over bend", "bend", "rad", "relax"),
    ],
    "wire_paths.router_height": [curve("height", "height", "m")],
    "wire_paths.worn_height": [curve("height over tension", "tension", "N")],
}
JOINT = {
    "joint.aimed": [
        curve("angle over command", "aim", "rad"),
        curve("angle over command of the next joint", "ahead", "rad"),
        curve("angle over command of the previous joint", "behind", "rad"),
        curve("gain over setting", "setting", "rad", "aim"),
    ],
    "joint.followed": [*memory("of angle over command", "moved", "rad", "settle", moves=True)],
    "joint.shown": [
        *memory("of angle over command of the next joint", "ahead", "rad", "settle", moves=True),
        *memory("of angle over command of the previous joint", "behind", "rad", "settle", moves=True),
    ],
}
SCALES = {"sliding.braked": "load"}  # what is as large as the law may be, where the value of the point is not
FORMS = SLIDING | SIGNAL | TENDON | MOTOR | SENSORS | FINGER | JOINT
# points that take no free law: factors, states, tuples, and values that another point carries
NONE = {
    "motor.follow", "motor.loop_gain", "motor.integral_gain", "motor.current_limit", "motor.drag", "motor.settle",
    "motor.winding", "tendon.near_end", "tendon.far_end", "tendon.at_cell", "tendon.at_spool", "tendon.settle",
    "sensor.lag", "sensor.mixed", "sensor.settle", "finger.external", "finger.relax", "wire_paths.lever_height",
    "bus.sent", "joint_command.sent", "joint.settle", "signal.mixed", "signal.delivered",
    "sliding.settle",
}  # fmt: skip
PLAIN = ("dt", "held", "arrival", "period", "mobility", "bones", "history")  # arguments that no law depends on


@dataclass(frozen=True)
class LawPoint:
    """A point of a machine with the forms of law that may be missing there.

    Attributes:
        key: "module.point".
        identity: id of the free law while it is searched.
        point: the point.
        arguments: names of the value and of what is known beside it.
        forms: as `FORMS` has them.
        scale: source of what is as large as the law may be.
        advanced: arguments of the points that advance states, by name.
    """

    key: str
    identity: str
    point: Point
    arguments: tuple[str, ...]
    forms: tuple[Form, ...]
    scale: str
    advanced: dict[str, tuple[str, ...]]

    @property
    def learned(self) -> str:
        """Id of the effect that the fitted law becomes."""
        return self.identity.replace(".law_", ".learned_")

    @property
    def block(self) -> str:
        """Block of the robot that it acts in."""
        return self.identity.split(".")[0]


def law_points(machine: Machine) -> Iterator[LawPoint]:
    """Points of a machine where a law may be missing."""
    for part in machine.parts:
        for point in part.points:
            key = f"{module_name(point.module or part.module)}.{point.name}"
            families = {p.standard.split(".")[0] for p in part.points if p.standard}
            names = {key, *(f"{family}.{point.name}" for family in families)}
            if names & NONE:
                continue
            own = arguments(part, point)
            forms = next((FORMS[n] for n in names if n in FORMS), None)
            forms = [for_value(f, own[0]) for f in forms] if forms is not None else fallback(own)
            advances = {a for f in forms for a in (f.advances, f.rate[0]) if a}
            known = {p.name: arguments(part, p) for p in part.points if p.name in advances}
            scale = next((SCALES[n] for n in names if n in SCALES), own[0])
            yield LawPoint(key, identity(machine, part, key, point), point, own, tuple(forms), scale, known)


def for_value(form: Form, value: str) -> Form:
    """A form of a family of parts with the name of the value at one part's point."""
    return replace(form, factor=form.factor.replace(VALUE, value))


def identity(machine: Machine, part: Part, key: str, point: Point) -> str:
    """Id of the law at a point: in the block of most effects of the library that act there, else of the part."""
    blocks = [effect.block for effect in machine.effects if key in effect.at] or [part.name]
    return f"{max(blocks, key=blocks.count)}.law_{point.name}"


def arguments(part: Part, point: Point) -> tuple[str, ...]:
    """Names of a point's arguments after the effects' parameters, their states and the channel."""
    function = getattr(point.module or part.module, point.name)
    return tuple(inspect.signature(function).parameters)[3 if point.axis else 2 :]


def fallback(names: tuple[str, ...]) -> list[Form]:
    """Curves of all arguments of a point that nothing is known about."""
    return [curve(f"{names[0]} over {name}", name, "") for name in names if name not in PLAIN]
