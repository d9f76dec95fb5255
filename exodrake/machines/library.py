"""The machine library: folders with `machine.py` and `robot.yaml`, here and in plugins.

A folder `robots` holds further robots, `exo_index/wide_pinch` for `exo_index/robots/wide_pinch.yaml`.
"""

from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path

import exodrake.machines
from exodrake.core import plugins
from exodrake.core.errors import InputError, nearest
from exodrake.core.schema import read_yaml
from exodrake.model.machine import Machine, Tolerance
from exodrake.model.units import add_kind


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
        content, source = read_yaml(folder / plugins.ROBOT), f"{name}/{plugins.ROBOT}"
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
