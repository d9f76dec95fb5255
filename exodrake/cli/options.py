"""Options that commands share: --robot with --machine, and --plugin."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from exodrake.core.errors import InputError

if TYPE_CHECKING:
    from exodrake.core.robot import Robot

DEFAULT = "exo_index"  # the machine of a command that is given none
MACHINE = "exodrake.machine"  # key of the machine that --machine registered, in the context's `meta`
ARGUMENTS = "exodrake.arguments"  # key of the arguments as they were typed
# why a command does not take a machine of the user's own
OTHERS: dict[str, str] = {
    "demo": "its hidden fault comes from the reference simulator of the Exo-Index; the test of `exodrake new-machine` "
    "injects one into yours",
    "identify": "it finds the axes of the Exo-Index's finger in marker recordings",
    "workspace": "it solves the statics of the Exo-Index's finger",
    "train": "its estimator maps stroke and tension of the Exo-Index's tendons to joint angles",
    "estimate": "its estimator maps stroke and tension of the Exo-Index's tendons to joint angles",
    "grasp": "it plans grasps of the Exo-Index's finger",
    "blind": "its reference simulator is a second model of the Exo-Index; `exodrake calibrate` counts the errors of "
    "another machine's diagnosis",
    "warm-up": "it compiles the Exo-Index; another machine is compiled at its first use",
    "new-machine": "it makes one",
}


class AnyPath(click.Path):
    """A path, which is refused if it is empty: it would stand for the current folder."""

    def __init__(self, dir_okay: bool = True) -> None:
        super().__init__(dir_okay=dir_okay, path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path."""
        if not os.fspath(value):
            self.fail("an empty path; a variable that is not set?", param, ctx)
        return super().convert(value, param, ctx)


class OutputFile(AnyPath):
    """A file to be written, which is refused before the work if it is a folder, or its own folder is absent."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Path of the file."""
        path = super().convert(value, param, ctx)
        if path.is_dir():
            raise InputError(f"{path}: a folder, wanted a file")
        if not path.parent.is_dir():
            raise InputError(f"{path}: cannot be written (no folder {path.parent})")
        return path


class OutputFolder(AnyPath):
    """A folder to be written, which is refused before the work if it cannot be one."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Path of the folder."""
        from exodrake.core.files import check_folder

        path = super().convert(value, param, ctx)
        check_folder(path)
        return path


def log_in(path: Path) -> Path:
    """A log's file: the path itself, or the log in a folder that `exodrake simulate` wrote."""
    return path / "log.csv" if path.is_dir() else path


def command_line() -> str:
    """The command as it was typed, for answers: absolute paths by their last part; empty outside of a command."""
    context = click.get_current_context(silent=True)
    return shlex.join(["exodrake", *map(without_folder, context.meta[ARGUMENTS])]) if context else ""


def without_folder(argument: str) -> str:
    """An argument, `FILE` or `--option=FILE`, whose absolute path is cut to its last part."""
    option, equals, path = argument.partition("=") if argument.startswith("-") else ("", "", argument)
    return f"{option}{equals}{os.path.basename(os.path.normpath(path))}" if os.path.isabs(path) else argument


def robot_option(name: str = "robot", default: str = DEFAULT) -> Callable[[Callable], Callable]:
    """Adds --robot, and --machine for the folder of a machine of the user's own, to a command.

    Args:
        name: the command's parameter for the robot file or machine name.
        default: its value if neither option is given.
    """

    def add(command: Callable) -> Callable:
        machine = click.option(
            "--machine", metavar="FOLDER", expose_value=False, is_eager=True, callback=machine_added,
            help="Folder of a machine of your own (robot.yaml, machine.py); its robot is the default.",
        )  # fmt: skip
        robot = click.option(
            "--robot", name, default=default, metavar="FILE", callback=robot_named,
            help="Robot file, or the name of a machine or built-in robot.",
        )  # fmt: skip
        return robot(machine(command))

    return add


def robot_changes(command: Callable) -> Callable:
    """Adds --set, --effect and --part, which change a robot, to a command; each is repeatable."""
    options = (
        ("--set", "parameters", "finger.kappa.MCP=0.09, or 'tendon.k=2.7 N/mm'. Repeatable."),
        ("--effect", "effects", "ID[:name=value,...][@AF,MF]; `exodrake effects` lists them. Repeatable."),
        ("--part", "parts", "A variant part: controller_as_printed, routers_as_printed, finger_at_rest. Repeatable."),
    )
    for flag, name, text in reversed(options):
        command = click.option(flag, name, multiple=True, metavar="TEXT", help=text)(command)
    return command


def machine_added(context: click.Context, _: click.Parameter, folder: str | None) -> None:
    """Registers the folder of --machine; InputError if it holds no machine."""
    if folder is None:
        return
    from exodrake.core import plugins

    path = plugins.add_plugin(folder)
    if not plugins.is_machine(path):
        raise InputError(f"{folder}: no {plugins.MACHINE} or {plugins.ROBOT} in it")
    context.meta[MACHINE] = path.name


def without_machine(name: str, command: click.Command) -> click.Command:
    """The command, and its subcommands, with a --machine that says why there is none, unless they take one."""
    if isinstance(command, click.Group):
        for one in command.commands.values():
            without_machine(name, one)
    if name in OTHERS and all("--machine" not in parameter.opts for parameter in command.params):

        def refuse(context: click.Context, parameter: click.Parameter, folder: str | None) -> None:
            if folder is not None:
                raise InputError(f"{name} takes no --machine: {OTHERS[name]}")

        option = click.Option(["--machine"], hidden=True, expose_value=False, is_eager=True, callback=refuse)
        command.params.append(option)
    return command


def refuse_others(name: str, robot: Robot, parameter: str) -> None:
    """InputError with the reason why a command does not take a machine that lacks a parameter."""
    if not any(one.name.startswith(f"{parameter}.") for one in robot.machine.parameters):
        raise InputError(f"{robot.machine.name}: not for `exodrake {name}`, since {OTHERS[name]}")


def robot_named(context: click.Context, parameter: click.Parameter, value: Any) -> Any:
    """The value of --robot, or the machine of --machine where only that is given."""
    given = context.get_parameter_source(str(parameter.name)) is click.core.ParameterSource.COMMANDLINE
    return value if given else context.meta.get(MACHINE, value)


def plugin_added(_: click.Context, __: click.Parameter, folders: tuple[str, ...]) -> None:
    """Registers the folders of --plugin."""
    if folders:
        from exodrake.core import plugins

        for folder in folders:
            plugins.add_plugin(folder)


def tried_of(robot: str, only: str, without: str) -> frozenset[str] | None:
    """Ids of the effects to try, from lists with commas; None for the default ones. robot: its file, or a name."""
    if not only and not without:
        return None
    from exodrake.diagnosis.candidates import chosen
    from exodrake.machines.robot_file import load_robot

    machine = (load_robot(robot) if robot else load_robot()).machine
    return chosen(machine, *([word.strip() for word in text.split(",") if word.strip()] for text in (only, without)))
