"""Robot files, read and written: a machine with its parameters, all of them or what differs from a `base`.

`docs/howto/robot.md` describes them. Numbers are in SI, or have their unit: `2.5 N/mm`, or `{value: 2.5, unit: N/mm}`.
`machine` names a folder with `machine.py` and `robot.yaml`, here or in a plugin, or with a robot file alone that has an
`arm` or `servos`. Its folder `robots` holds further ones: `exo_index/wide_pinch` is `exo_index/robots/wide_pinch.yaml`.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

import exodrake.machines
from exodrake.core import plugins, schema
from exodrake.core.errors import InputError, argument, nearest
from exodrake.core.files import is_file, read_bytes, write_text
from exodrake.core.schema import Schema, anything, dump_yaml, either, listing, mapping, names, number, optional, text
from exodrake.model.machine import Machine, Tolerance
from exodrake.model.part import TENDONS
from exodrake.model.robot import Robot, flatten, refuse_negative
from exodrake.model.units import add_kind, quantity


def amount(value: Any, where: str) -> Any:
    """A number, or text that `quantity` reads later, when the unit wanted is known."""
    return value if isinstance(value, str) else number()(value, where)


VALUES = names(amount)
VALUE = either(VALUES, amount)  # one, or one per channel
STATED = {"unit": text(), "range": listing(amount, length=2, wanted="[low, high]"), "source": anything}
NESTED = either(mapping({"value": VALUE} | STATED), lambda value, where: PARAMETERS(value, where), "value")
PARAMETERS: Schema = names(either(NESTED, amount))
LIMIT = either(mapping({"value": VALUES, "unit": text(), "range": anything, "source": anything}), VALUES, "value")
EFFECTS = names(names(either(mapping({"value": VALUE, "source": anything}), VALUE, "value")))
VARIANTS = listing(text(), wanted="a list of names")
TOLERANCE = {
    "parameters": VARIANTS, "transform": text(("relative", "additive", "log")), "prior_std": number(above=0.0),
    "max_deviation": number(above=0.0),
}  # fmt: skip
OF_MACHINES = "arm", "servos"  # sections from which the machine itself is made
SCHEMA = mapping(
    {
        "machine": optional(text()), "base": optional(text()), **dict.fromkeys((*OF_MACHINES, "notes"), anything),
        "parameters": optional(PARAMETERS), "effects": optional(EFFECTS), "parts": optional(VARIANTS),
        "limits": optional(names(LIMIT)), "grasps": optional(names(VALUES)),
        "tolerances": optional(listing(mapping(TOLERANCE, required=tuple(TOLERANCE)))),
    }
)  # fmt: skip


def machine_folders() -> dict[str, Path]:
    """Folder of each machine by name: built-in ones first; a plugin cannot replace them."""
    found: dict[str, Path] = {}
    for place in map(Path, exodrake.machines.__path__):
        for file in sorted(place.glob(f"*/{plugins.ROBOT}")):
            found.setdefault(file.parent.name, file.parent)
    return {**plugins.single_machines(), **found}


def robot_files() -> dict[str, Path]:
    """Robot file of each built-in robot by name: `machine` for the nominal one, `machine/robot` for the others."""
    found: dict[str, Path] = {}
    for name, folder in machine_folders().items():
        found[name] = folder / plugins.ROBOT
        found |= {f"{name}/{file.stem}": file for file in sorted(folder.glob("robots/*.yaml"))}
    return found


@cache
def machine_named(name: str, tolerances: tuple[Tolerance, ...] = ()) -> Machine:
    """The machine of that name with its tolerances; the same object each time, so that it is compiled once."""
    folders = machine_folders()
    if name not in folders:
        raise InputError(f"unknown machine {name!r}{nearest(name, list(folders))}; known: {', '.join(folders)}")
    folder = folders[name]
    if (folder / plugins.MACHINE).is_file():
        with plugins.shown_errors():
            made = getattr(import_module(f"exodrake.machines.{name}.machine"), "machine", None)
            found = made() if callable(made) else made
        if not isinstance(found, Machine):
            raise InputError(f"{folder}: machine.py defines no function machine() that returns a Machine")
    else:
        content, source = schema.read_yaml(folder / plugins.ROBOT), f"{name}/{plugins.ROBOT}"
        if isinstance(content, dict) and "servos" in content:
            from exodrake.machines.position_servos import servo_machine

            found = servo_machine(name, content["servos"], source)
        elif isinstance(content, dict) and "arm" in content:
            from exodrake.machines.serial_arm import arm_machine

            found = arm_machine(name, content["arm"], folder, source)
        else:
            raise InputError(f"{folder}: neither {plugins.MACHINE}, nor an `arm` or `servos` in its {plugins.ROBOT}")
    if found.name != name:
        raise InputError(f"{folder}: the machine calls itself {found.name!r}, not {name!r}")
    for column in found.columns:
        add_kind(column.kind, found.signal[column.signal].unit, f"machine {name}")
    return replace(found, tolerances=tolerances)


def load_robot(path: str | Path = "exo_index", above: tuple[str, ...] = ()) -> Robot:
    """The robot of a file, or of a machine by its name.

    Args:
        path: robot file, folder of a machine, or name of a machine or other built-in robot: `exo_index/wide_pinch`.
        above: files whose base this one is, for the message about a ring.

    Raises:
        InputError: naming file and key.

    Examples:
        >>> load_robot("exo_index")["finger.kappa.MCP"]
        0.08
    """
    file, shipped = Path(path), robot_files().get(str(path))
    if shipped is None and plugins.is_machine(file):
        added = plugins.add_plugin(file).name
        shipped = robot_files().get(added)
    if shipped is not None:
        source, data, place, file = f"{path}.yaml", read_bytes(shipped), None, shipped
    else:
        if not is_file(file):
            if inside := sorted(map(str, file.glob("*.yaml"))):
                raise InputError(f"{path}: is a folder; name a robot file, such as {inside[0]}")
            if file.suffix in (".yaml", ".yml"):
                there = [*file.parent.glob("*.yaml"), *file.parent.glob(f"*/{file.name}")]
                raise InputError(f"no robot file {str(path)!r}{nearest(str(path), list(map(str, there)))}")
            names = list(robot_files())
            near, there = nearest(str(path), names), ", ".join(names)
            raise InputError(f"no robot file {str(path)!r}, nor a machine of that name{near or f'; there are {there}'}")
        source, data, place = file.name, read_bytes(file), file.parent
    if file.name == plugins.ROBOT:  # as every machine's is called
        source = f"{file.resolve().parent.name}/{file.name}"
    return build(schema.parse_yaml(data, source), source, above or (str(path),), place)


def robot_or_default(robot: Robot | None) -> Robot:
    """The robot, or the built-in one for None. TypeError for anything else."""
    return argument("robot", robot, Robot, type(None)) or load_robot()


def build(content: Any, source: str, above: tuple[str, ...] = (), folder: Path | None = None) -> Robot:
    """A robot from the content of the file `source` in a folder, to which some bases above led.

    A machine that is the file's own folder, and a base that is a machine's folder beside the file or its folder too, is
    known from then on, code and all; a base that is a file is looked for there first. InputError names the key.
    """
    content = SCHEMA(content, source)
    base = content.get("base")
    named = base or content.get("machine")
    if folder is not None and named and named not in robot_files():
        own = folder.resolve()
        for beside in (folder / named, own, own.parent / named) if base else (own,):
            if beside.name == named and plugins.is_machine(beside):
                plugins.add_plugin(beside)
        if base and is_file(folder / base):
            base = str(folder / base)
    if base in above:
        raise InputError(f"{source}: base {content['base']!r} comes back to itself")
    for key in ("machine", "tolerances", *OF_MACHINES):
        if base and content.get(key):
            raise InputError(f"{source}, {key!r}: a robot with a base has the {key} of its base")
    if not base and any(key in content for key in OF_MACHINES) and named not in robot_files():
        raise InputError(f"{source}: a machine of one's own is a folder of its name, {named}/{plugins.ROBOT}")
    try:
        parameters = content.get("parameters") or {}
        if base:
            robot = load_robot(base, (*above, base))
        else:  # effects at their null values, and what the file must state unset
            groups = content.get("tolerances") or ()
            tolerances = tuple(Tolerance(**{**one, "parameters": tuple(one["parameters"])}) for one in groups)
            machine = machine_named(str(content.get("machine")), tolerances)
            given = {name for name, *_ in flatten(parameters)} | machine.defaults.keys()
            for p in machine.parameters:
                if p.null is None and given.isdisjoint((p.name, p.name.rsplit(".", 1)[0])):
                    split = any(name.startswith(f"{p.name}.") for name in given)
                    raise InputError(f"{source}: parameter {p.name} {'wants one value' if split else 'is missing'}")
            unset = [machine.defaults.get(p.name, math.nan) if p.null is None else p.null for p in machine.parameters]
            robot = Robot(machine, np.array(unset), dict.fromkeys(machine.defaults, "default of the machine"))
        robot = replace(robot, source=source)
        for part in content.get("parts") or ():
            robot = robot.with_part(part)
        robot = robot.with_parameters(parameters, source)
        sources, ranges = dict(robot.sources), dict(robot.ranges)  # that the file states beside its values
        for indices, (_, _, item) in robot.general_first(flatten(parameters)):
            for parameter in (robot.machine.parameters[i] for i in indices if item):
                sources[parameter.name] = str(item.get("source", ""))
                if "range" in item:
                    where, unit = f"{robot.source}: range of {parameter.name}", item.get("unit", "")
                    low, high = (quantity(end, parameter.unit, where, unit) for end in item["range"])
                    if low > high:
                        raise InputError(f"{where}: {low:g} exceeds {high:g}")
                    ranges[parameter.name] = (low, high)
        robot = refuse_negative(replace(robot, sources=sources, ranges=ranges))
        for identity, items in (content.get("effects") or {}).items():
            stated = {name: v for name, v in items.items() if isinstance(v, Mapping) and "value" in v}
            given = items | {name: v["value"] for name, v in stated.items()}
            channels = {channel for v in given.values() if isinstance(v, Mapping) for channel in v}
            robot = robot.splice(identity, given, [channel for channel in channels if channel])
            for name, v in stated.items():
                for i in robot.machine.effect_indices(identity, name).values():
                    robot.sources[robot.machine.parameters[i].name] = str(v.get("source", ""))
        unit, targets = reference_unit(robot.machine), {"limits": dict(robot.limits), "grasps": dict(robot.grasps)}
        for key, found in targets.items():  # those of the base and of the file, channel by channel
            for name, item in (content.get(key) or {}).items():
                where, given = f"{source}: {key}.{name}", item.get("unit", "")
                values = {c: quantity(v, unit, f"{where}.{c}", given) for c, v in item.get("value", item).items()}
                found[name] = found.get(name, {}) | values
        limits, first = targets["limits"], robot.machine.references[:1]
        pulling = any(robot.machine.signal[column.signal].axis == TENDONS for column in first)
        for name, channel, value in ((n, c, v) for n, item in limits.items() for c, v in item.items()):
            if value < 0 and pulling:
                raise InputError(f"{source}: limit {name}.{channel} is {value} {unit}, below 0")
        lowest, highest = robot.machine.reference_limits or ("", "")
        for channel, low in limits.get(lowest, {}).items():
            if low > limits.get(highest, {}).get(channel, math.inf):
                raise InputError(f"{source}: {lowest}.{channel} = {low} {unit} exceeds {highest}.{channel}")
        return replace(robot, **targets)
    except InputError as problem:
        raise problem if source in str(problem) else InputError(f"{source}: {problem}") from None


def reference_unit(machine: Machine) -> str:
    """Unit of the references; "-" without any."""
    return machine.signal[machine.references[0].signal].unit if machine.references else "-"


def write_robot(robot: Robot, path: str | Path, notes: str = "") -> None:
    """Writes `robot_text`. InputError if it cannot be written; the file is whole or not there.

    Examples:
        >>> import exodrake as exo
        >>> write_robot(exo.load_robot("emps"), "mine.yaml")
        >>> exo.load_robot("mine.yaml")
        Robot(emps from mine.yaml: 37 parameters; no effects)
    """
    write_text(path, robot_text(argument("robot", robot, Robot), notes))


def robot_text(robot: Robot, notes: str = "") -> str:
    """Text of a robot file that `load_robot` takes: what differs from its machine; all, with tolerances of its own."""
    base = load_robot(robot.machine.name)
    own = robot.machine.tolerances != base.machine.tolerances
    effects: dict[str, dict[str, Any]] = {identity: {} for identity in robot.effects()}
    for identity, present in robot.effects().items():
        for name, values in present.items():
            places = robot.machine.effect_indices(identity, name).values()
            sources = {robot.sources.get(robot.machine.parameters[i].name, "") for i in places} - {""}
            value = values.get("", values)
            effects[identity][name] = {"value": value, "source": sources.pop()} if len(sources) == 1 else value
    parameters: dict[str, dict[str, Any]] = {}  # nominal ones that differ from the machine's; all, if it has its own
    for p, v in zip(robot.machine.parameters, robot.values, strict=True):
        span = robot.ranges.get(p.name)
        ranged = span is not None and (own or span != base.ranges.get(p.name))
        if p.null is None and (own or v != base[p.name] or ranged):
            parameters[p.name] = {"value": float(v), "unit": p.unit, "source": robot.sources.get(p.name, "")}
            parameters[p.name] |= {"range": [float(end) for end in span]} if ranged and span else {}
    unit = {} if (name := reference_unit(robot.machine)) == "-" else {"unit": name}
    content = {
        "machine" if own else "base": robot.machine.name,
        "tolerances": [{**vars(t), "parameters": list(t.parameters)} for t in robot.machine.tolerances] if own else [],
        "parameters": parameters,
        "effects": effects,
        "parts": list(robot.machine.variant_names),
        "limits": {k: {"value": v, **unit} for k, v in robot.limits.items() if own or v != base.limits.get(k)},
        "grasps": {k: v for k, v in robot.grasps.items() if own or v != base.grasps.get(k)},
        "notes": notes,
    }
    return dump_yaml({k: v for k, v in content.items() if v})
