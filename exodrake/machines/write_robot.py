"""Robot files, written."""

from __future__ import annotations

from pathlib import Path

from exodrake.core.argument import argument
from exodrake.core.files import write_text
from exodrake.core.robot import Robot
from exodrake.core.yaml_file import dump_yaml
from exodrake.machines.robot_file import load_robot, reference_unit


def write_robot(robot: Robot, path: str | Path, notes: str = "") -> None:
    """Writes `robot_text`. InputError if it cannot be written; the file is whole or not there."""
    write_text(path, robot_text(argument("robot", robot, Robot), notes))


def robot_text(robot: Robot, notes: str = "") -> str:
    """Text of a robot file that `load_robot` takes: what differs from its machine, effects and limits too."""
    base = load_robot(robot.machine.name)
    parameters = {
        e.name: {"value": float(v), "unit": e.unit, "source": robot.sources.get(e.name, "")}
        for e, v in zip(robot.machine.parameters, robot.values, strict=True)
        if e.null is None and v != base[e.name]
    }
    effects = {
        identity: {name: values.get("", values) for name, values in present.items()}
        for identity, present in robot.effects().items()
    }
    unit = {} if (name := reference_unit(robot.machine)) == "-" else {"unit": name}
    content = {
        "base": robot.machine.name,
        "parameters": parameters,
        "effects": effects,
        "parts": list(robot.machine.variant_names),
        "limits": {k: {"value": v, **unit} for k, v in robot.limits.items() if v != base.limits.get(k)},
        "grasps": {k: v for k, v in robot.grasps.items() if v != base.grasps.get(k)},
        "notes": notes,
    }
    return dump_yaml({k: v for k, v in content.items() if v})
