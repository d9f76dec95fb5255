"""What commands share: options, files that they write, and the display while they work.

The convention: `--out` is the folder of a command's files, or the file of one that writes one (a folder for it will
do). They have the same names everywhere: log.csv, figure.png, report.html, diagnosis.json, robot.yaml. Without it
nothing is written, or a place of the command's own that its help names: a run goes into a folder named after it, an
animation beside its log. Every command takes `--json`: it prints the numbers and nothing else, or writes them into the
file that it names. A command without numbers lists the files that it wrote.
"""

from __future__ import annotations

import io
import json
import os
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, redirect_stdout
from functools import partial, wraps
from pathlib import Path
from typing import Any

import click

import exodrake as exo
from exodrake.core import plugins
from exodrake.core.errors import InputError, nearest
from exodrake.core.files import check_folder, is_folder, make_folder, write_bytes, write_folder
from exodrake.core.progress import waiting as waiting

option = partial(click.option, show_default=True)
CASE = click.argument("cases", nargs=-1, required=True, metavar="CASE_OR_LOG...")
DEFAULT = "exo_index"  # the machine of a command that is given none
MACHINE = "exodrake.machine"  # key of the machine that --machine registered, in the context's `meta`
ARGUMENTS = "exodrake.arguments"  # key of the arguments as they were typed
WRITTEN, STATUS = "exodrake.written", "exodrake.status"  # keys of the files written, and of the exit status
STDOUT = Path("-")  # for --json
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
    """A path, which is refused if it is empty: it would stand for the current folder.

    Args:
        check: Raises InputError, before the work, for a path that cannot be written; may return another one.
    """

    def __init__(self, check: Callable[[Path], Path | None] = lambda path: path) -> None:
        super().__init__(path_type=Path)
        self.check = check

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path that is meant."""
        if not os.fspath(value):
            self.fail("an empty path; a variable that is not set?", param, ctx)
        path: Any = super().convert(value, param, ctx)
        return self.check(path) or path


class OutputFile(AnyPath):
    """A file to be written, or a folder for it; one that cannot be written is refused before the work.

    Args:
        name: Name of the file in a folder. Its ending is demanded of other names, unless it is that of a log.
    """

    def __init__(self, name: str = "") -> None:
        super().__init__(self.name_file)
        self.usual = name

    def name_file(self, path: Path) -> Path:
        """The file, in a folder under its usual name."""
        kind = Path(self.usual).suffix
        if self.usual and (path.is_dir() or not (path.suffix or path.exists())):
            check_folder(path)
            return path / self.usual
        check_target(path)
        if kind not in ("", ".csv", path.suffix.lower()) and path.suffix:
            raise InputError(f"{path}: wanted a folder, or a file whose name ends in {kind}")
        return path


OutputFolder = partial(AnyPath, check_folder)  # a folder to be written


def check_target(path: Path) -> None:
    """InputError before the work if a file could not be written in the end."""
    if path.is_dir():
        raise InputError(f"{path}: a folder, wanted a file")
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written (no folder {path.parent})")
    check_folder(path.parent)


def check_json(path: Path) -> None:
    """InputError for a JSON file that cannot be written; `-` is the standard output."""
    if path != STDOUT:
        if path.suffix.lower() != ".json":
            raise InputError(f"--json {path}: wanted a file whose name ends in .json, or --json last, to print")
        check_target(path)


json_target = click.option(
    "--json", "json_file", type=AnyPath(check_json), is_flag=False, flag_value="-", metavar="[FILE]",
    help="Print the answer as JSON, in SI, and nothing else; or write it into FILE.",
)  # fmt: skip


def command(make: Callable[..., Any] = click.command, *words: str, **settings: Any) -> Callable[[Callable], Any]:
    """Makes a function a command, by click's `make`, with --json for what it returns, else for the files it wrote."""

    def build(function: Callable) -> Any:
        @wraps(function)
        def answering(*arguments: Any, json_file: Path | None, **options: Any) -> None:
            with quiet(json_file):
                answer = function(*arguments, **options)
            written = click.get_current_context().meta.get(WRITTEN, [])
            end({"wrote": written} if answer is None else answer, json_file)

        json_target(answering)
        parameters: list = answering.__click_params__  # pyright: ignore[reportAttributeAccessIssue]
        parameters.insert(0, parameters.pop())  # the last line of --help
        return make(*words, **settings)(answering)

    return build


def note_failures(failed: Mapping[Any, object]) -> None:
    """Prints why some parts of a command failed; it ends with status 1, once its answer is written."""
    for name, reason in failed.items():
        click.echo(f"{name}: {reason}", err=True)
    click.get_current_context().meta[STATUS] = int(bool(failed))


def quiet(json_file: Path | None) -> AbstractContextManager:
    """A context that prints nothing where the answer alone is to be printed."""
    return redirect_stdout(io.StringIO()) if json_file == STDOUT else nullcontext()


def end(answer: Any, json_file: Path | None) -> None:
    """Prints or writes the answer of a command as JSON where that is wanted, and ends with its status."""
    if json_file == STDOUT:
        click.echo(json_text(answer), nl=False)
    elif json_file:
        write_files({json_file: json_text(answer)})
    context = click.get_current_context()
    if status := context.meta.get(STATUS):
        context.exit(status)


def note_written(paths: Iterable[Path]) -> None:
    """Keeps the names of files that a command wrote, for its answer as JSON."""
    click.get_current_context().meta.setdefault(WRITTEN, []).extend(str(path) for path in paths)


def json_text(result: Any) -> str:
    """A result as the text of a JSON file."""
    from exodrake.core.plain import plain

    return json.dumps(plain(result), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def encode(path: Path, content: Any) -> bytes:
    """Bytes of a file, from its bytes, text, a log (in the format of the ending) or a figure (PNG)."""
    if isinstance(content, str | bytes):
        return content.encode() if isinstance(content, str) else content
    from exodrake.data import formats, plot

    return formats.log_bytes(content, path) if isinstance(content, exo.Log) else plot.render_png(content)


def write_files(contents: Mapping[Path, Any], announce: bool = True) -> None:
    """Write files that `encode` takes, each whole or not at all, in folders that are made; and say where they are."""
    for path, data in {path: encode(path, content) for path, content in contents.items()}.items():
        make_folder(path.parent)
        write_bytes(path, data)
        note_written([path])
        if announce:
            click.echo(f"wrote {path}")


def write_together(folder: Path, contents: Mapping[str, Any]) -> list[Path]:
    """Write files that `encode` takes into a folder, all of them or none."""
    paths = write_folder(folder, {name: encode(folder / name, content) for name, content in contents.items()})
    note_written(paths)
    return paths


def write_answer(answer: Any, name: str, out: Path | None, files: Mapping[str, Any]) -> Any:
    """Write an answer as JSON, and further files, into the folder `out`, if there is one; returns the answer."""
    if out:
        write_files({out / file: data for file, data in {**files, f"{name}.json": json_text(answer)}.items()})
    return answer


def print_table(titles: Sequence[str], rows: Sequence[Any], wrapped: int = -1) -> None:
    """Print a table; into a pipe 120 columns wide."""
    from rich.console import Console

    from exodrake.report import terminal

    console = Console(highlight=False)
    console.width = console.width if console.is_terminal else max(console.width, 120)
    terminal.print_table(console, titles, rows, wrapped)


def cases_in(folder: Path) -> list[Path]:
    """Folders of a folder that are cases, by name; none if it is a case itself."""
    from exodrake.data.case import FILE, log_names

    def is_case(path: Path) -> bool:
        return is_folder(path) and ((path / FILE).exists() or bool(log_names(path)))

    if not is_folder(folder) or is_case(folder):
        return []
    return [path for path in sorted(folder.iterdir()) if is_case(path)]


def refuse_cases(folder: Path) -> None:
    """InputError for a folder that holds cases, by a command that takes one."""
    if inside := cases_in(folder):
        raise InputError(f"{folder}: a folder of cases; name one of them, such as {inside[0]}")


def log_in(path: Path) -> Path:
    """A log's file: the path itself, or the log in a folder that `exodrake simulate` wrote."""
    return path / "log.csv" if path.is_dir() else path


def command_line() -> str:
    """The command as it was typed, for answers: absolute paths by their last part."""
    words = ["exodrake"]
    for argument in click.get_current_context().meta[ARGUMENTS]:
        option, equals, path = argument.partition("=") if argument.startswith("-") else ("", "", argument)
        last = os.path.basename(os.path.normpath(path))
        words.append(f"{option}{equals}{last}" if os.path.isabs(path) else argument)
    return shlex.join(words)


def robot_option(default: str = DEFAULT) -> Callable[[Callable], Callable]:
    """Adds --robot, and --machine for the folder of a machine of the user's own, to a command."""

    def add(command: Callable) -> Callable:
        machine = click.option(
            "--machine", metavar="FOLDER", expose_value=False, is_eager=True, callback=register_machine,
            help="Folder of a machine of your own (robot.yaml, machine.py); its robot is the default.",
        )  # fmt: skip
        robot = click.option(
            "--robot", default=default, metavar="FILE", callback=choose_robot,
            help="Robot file, a machine's folder, or the name of a machine or built-in robot.",
        )  # fmt: skip
        return robot(machine(command))

    return add


def robot_changes(command: Callable, default: str = DEFAULT) -> Callable:
    """Adds `robot_option`, and --set, --effect and --part, which change that robot, to a command."""
    options = (
        ("--set", "parameters", "finger.kappa.MCP=0.09, or 'tendon.k=2.7 N/mm'. Repeatable."),
        ("--effect", "effects", "ID[:name=value,...][@AF,MF]; `exodrake effects` lists them. Repeatable."),
        ("--part", "parts", "A variant part: controller_as_printed, routers_as_printed, finger_at_rest. Repeatable."),
    )
    for flag, changed, text in reversed(options):
        command = click.option(flag, changed, multiple=True, metavar="TEXT", help=text)(command)
    return robot_option(default)(command)


def load_changed(robot: str, parameters: Sequence[str], effects: Sequence[str], parts: Sequence[str]) -> exo.Robot:
    """The robot of `robot_changes`: parts are changed first, then parameters, then effects."""
    from exodrake.simulation.scenario import change_robot

    return change_robot(exo.load_robot(robot), parameters, effects, parts)[0]


def reference_log(robot: exo.Robot, reference: exo.Reference, label: str = "") -> exo.Log:
    """References of a robot as a log, in the units of its machine."""
    import numpy as np

    machine = robot.machine
    units = {name: machine.signal[c.signal].unit for c in machine.references for name in machine.log_names([c])}
    signals = dict(zip(units, reference.values.T, strict=True))
    return exo.Log(machine.frame * np.arange(len(reference.values)), signals, units, label)


def register_machine(context: click.Context, _: click.Parameter, folder: str | None) -> None:
    """Registers the folder of --machine, or chooses a built-in machine by name; InputError if there is none."""
    from exodrake.machines.robot_file import machine_folders

    if folder is None:
        return
    if not Path(folder).exists():
        if folder not in (known := machine_folders()):
            hint = nearest(folder, [*known])
            raise InputError(f"{folder}: no such folder of a machine, nor a machine of that name{hint}")
        context.meta[MACHINE] = folder
        return
    path = plugins.add_plugin(folder)
    if not plugins.is_machine(path):
        raise InputError(f"{folder}: no {plugins.MACHINE} or {plugins.ROBOT} in it")
    context.meta[MACHINE] = path.name


def refuse_others(name: str, robot: exo.Robot) -> None:
    """InputError with the reason why a command does not take a machine without the finger."""
    if not any(one.name.startswith("finger.length.") for one in robot.machine.parameters):
        raise InputError(f"{robot.machine.name}: not for `exodrake {name}`, since {OTHERS[name]}")


def choose_robot(context: click.Context, parameter: click.Parameter, value: Any) -> Any:
    """The value of --robot, or the machine of --machine where only that is given."""
    given = context.get_parameter_source(str(parameter.name)) is click.core.ParameterSource.COMMANDLINE
    return value if given else context.meta.get(MACHINE, value)


def register_plugins(_: click.Context, __: click.Parameter, folders: tuple[str, ...]) -> None:
    """Registers the folders of --plugin."""
    for folder in folders:
        plugins.add_plugin(folder)


def choose_effects(robot: str, only: str, without: str) -> frozenset[str] | None:
    """Ids of the effects to try, from lists with commas; None for the default ones. robot: its file, or a name."""
    if not only and not without:
        return None
    from exodrake.diagnosis.problem import choose_tried

    lists = ([word.strip() for word in text.split(",") if word.strip()] for text in (only, without))
    return choose_tried(exo.load_robot(robot or DEFAULT).machine, *lists)
