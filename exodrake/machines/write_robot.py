"""Robot files, written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from exodrake.core.argument import argument
from exodrake.core.files import write_text
from exodrake.core.parameter import Tolerance
from exodrake.core.robot import Robot
from exodrake.core.yaml_file import dump_yaml
from exodrake.machines.robot_file import load_robot, reference_unit


def write_robot(robot: Robot, path: str | Path, notes: str = "") -> None:
    """Writes `robot_text`. InputError if it cannot be written; the file is whole or not there."""
    write_text(path, robot_text(argument("robot", robot, Robot), notes))


def robot_text(robot: Robot, notes: str = "") -> str:
    """Text of a robot file that `load_robot` takes: what differs from its machine, effects and limits too.

    A robot with tolerances of its own states all its parameters.
    """
    base = load_robot(robot.machine.name)
    own = robot.machine.tolerances != base.machine.tolerances
    effects = {
        identity: {name: values.get("", values) for name, values in present.items()}
        for identity, present in robot.effects().items()
    }
    unit = {} if (name := reference_unit(robot.machine)) == "-" else {"unit": name}
    content = {
        "machine" if own else "base": robot.machine.name,
        "tolerances": [tolerance_entry(t) for t in robot.machine.tolerances] if own else [],
        "parameters": parameters_of(robot, None if own else base),
        "effects": effects,
        "parts": list(robot.machine.variant_names),
        "limits": {k: {"value": v, **unit} for k, v in robot.limits.items() if own or v != base.limits.get(k)},
        "grasps": {k: v for k, v in robot.grasps.items() if own or v != base.grasps.get(k)},
        "notes": notes,
    }
    return dump_yaml({k: v for k, v in content.items() if v})


def parameters_of(robot: Robot, base: Robot | None) -> dict[str, dict[str, Any]]:
    """Nominal parameters with value, unit, source and range, those that differ from a base's, if there is one."""
    found = {}
    for p, v in zip(robot.machine.parameters, robot.values, strict=True):
        span = robot.ranges.get(p.name)
        ranged = span is not None and (base is None or span != base.ranges.get(p.name))
        if p.null is None and (base is None or v != base[p.name] or ranged):
            found[p.name] = {"value": float(v), "unit": p.unit, "source": robot.sources.get(p.name, "")}
            found[p.name] |= {"range": [float(end) for end in span]} if ranged and span else {}
    return found


def tolerance_entry(tolerance: Tolerance) -> dict[str, Any]:
    """An entry of the `tolerances` list of a robot file."""
    return {**vars(tolerance), "parameters": list(tolerance.parameters)}
