"""The command line: `exodrake COMMAND`, whose module of `exodrake/cli` is imported when it is called."""

import errno
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import IO, Any

import click

from exodrake import __version__
from exodrake.cli.options import ARGUMENTS, OTHERS, register_plugins
from exodrake.core.errors import InputError, MissingColumn, nearest, printable, shorten
from exodrake.core.progress import INTERRUPTED

# heading -> command -> (module, with the name of the click command if it is not `command`; its line in --help)
GROUPS = {
    "Simulate": {
        "demo": ("blind:run_demo", "From a robot with a hidden fault to its name."),
        "simulate": ("simulate", "Run a robot, with or without effects, and write its log."),
        "sweep": ("simulate:sweep_parameters", "Many runs of a robot over its parameters, as a table."),
        "compare": ("logs:compare_logs", "Two logs over each other, with the RMS of each difference."),
        "show": ("logs:show_log", "Write a log as HTML with the moving robot."),
        "robot": ("robot:list_parameters", "A robot's parameters: value, range, tolerance, source."),
        "effects": ("robot:list_effects", "The effect library: what the nominal robot leaves out."),
        "draw": ("robot:draw", "Draw the robot's block diagram with its signals and slots."),
        "warm-up": ("simulate:compile_kernels", "Compile the kernels now, not at first use."),
    },
    "Diagnose": {
        "check": ("diagnose:check_case", "Before a diagnosis: what a case can tell, and what is wrong."),
        "diagnose": ("diagnose", "Where, which and how far: a robot's logs against its model."),
        "experiment": ("diagnose:design_experiment", "The motion that tells apart what a diagnosis could not."),
        "fleet": ("diagnose:summarise_fleet", "Many diagnosed cases: which robots, which causes, since when."),
        "watch": ("watch", "Follow a growing log: the gap per block, and an alarm."),
        "blind": ("blind", "Make, commit to and score cases from the reference simulator."),
    },
    "Logs and machines of your own": {
        "import": ("logs:import_recordings", "Turn a foreign recording into a log, by a mapping file."),
        "export": ("logs:export_log", "A log in another format; a robot as MJCF, URDF, Isaac Lab."),
        "new-machine": ("new_machine", "A folder with a machine of your own, which runs at once."),
        "fit": ("robot:fit_parameters", "Fit chosen parameters of a robot to its logs."),
        "calibrate": ("diagnose:count_errors", "Error rates of a machine's diagnosis."),
        "alarm-limits": ("watch:find_alarm_limits", "Gaps that healthy robots stay below, for the alarm of watch."),
    },
    "Control": {
        "analyse": ("control:analyse_loop", "Closed loop: steps, poles, margins, robustness."),
        "response": ("control:find_response", "Frequency response from a log, beside the robot's model."),
        "tune": ("control:tune_gains", "Choose the controller's gains within requirements."),
        "feedforward": ("control:find_commands", "Commands that make a robot do what is wanted, by its model."),
    },
    "The finger of the paper": {
        "identify": ("finger:identify_finger", "Find the finger's kinematics in a marker recording."),
        "workspace": ("finger:find_workspace", "Areas that the fingertip reaches, alone and pulled by tendons."),
        "train": ("finger:train_estimator", "Train the joint-angle estimator on logs."),
        "estimate": ("finger:estimate_angles", "Joint angles from stroke and tension, with their uncertainty."),
        "grasp": ("finger:plan_grasp", "From grasp mode and object size to joint targets and tensions."),
    },
}
OF_ANY_MACHINE = ("check", "diagnose", "fit", "watch", "analyse", "response", "experiment", "calibrate")
OTHER_MACHINE = "; a log of another machine? --machine FOLDER or --robot NAME says which"
COMMANDS = {name: command for group in GROUPS.values() for name, command in group.items()}


class InputProblem(click.ClickException):
    """Bad input, shown as one red line on stderr; exit status 2."""

    exit_code = 2

    def show(self, file: IO[Any] | None = None) -> None:
        """Print `error: message` on one line."""
        click.secho("error: " + shorten(printable(self.format_message())), fg="red", err=True)


@contextmanager
def in_one_line(arguments: tuple[str, ...] = ()) -> Iterator[None]:
    """Report a user's error or a full machine in one line, without a traceback; arguments: as they were typed."""
    try:
        yield
    except InputError as problem:
        given = any(word.startswith(("--machine", "--robot")) for word in arguments)
        missing = isinstance(problem, MissingColumn)
        foreign = missing and arguments and arguments[0] in OF_ANY_MACHINE and not given
        raise InputProblem(f"{problem}{OTHER_MACHINE if foreign else ''}") from None
    except click.UsageError as problem:
        if isinstance(problem, click.exceptions.NoArgsIsHelpError):
            raise
        raise InputProblem(explain_usage(problem)) from None
    except ValueError as problem:
        if "null byte" in str(problem):  # click asks the system about a path before any command sees it
            raise InputProblem("an argument holds a null byte") from None
        raise
    except MemoryError:
        raise InputProblem(f"out of memory: exodrake {shlex.join(sys.argv[1:])}") from None
    except OSError as problem:
        if problem.errno == errno.EPIPE:  # who read the output has gone
            raise
        raise InputProblem(f"{problem.filename or 'output'}: {problem.strerror or problem}") from None
    except KeyboardInterrupt:
        click.echo("interrupted", err=True)
        raise click.exceptions.Exit(INTERRUPTED) from None


def explain_usage(problem: click.UsageError) -> str:
    """One line on wrong options or arguments: what is wrong, and what a missing option is."""
    context, text = problem.ctx, problem.format_message()
    path = context.command_path if context else "exodrake"
    name = [*path.split(), ""][1]
    option = problem.option_name if isinstance(problem, click.NoSuchOption) else ""
    reasons = OTHERS | {"import": "--map FILE says which column is which, --machine FOLDER is a machine of your own"}
    if option in ("--machine", "--robot") and name in reasons:
        return f"{name} takes no {option}: {reasons[name]}"
    if isinstance(problem, click.MissingParameter) and isinstance(problem.param, click.Option):
        return f"{problem.param.opts[0]} is missing: {problem.param.help}"
    return text if text.endswith(("?", ")")) else f"{text.rstrip('.')}; {path} --help explains"


class OneLineErrors(click.Command):
    """A command whose bad input and Ctrl-C end in one line."""

    def make_context(self, *args: Any, **extra: Any) -> click.Context:
        """Parse the arguments."""
        with in_one_line():
            return super().make_context(*args, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        with in_one_line(ctx.meta.get(ARGUMENTS, ())):
            return super().invoke(ctx)


class LazyGroup(OneLineErrors, click.Group):
    """A group that imports a command's module when the command is called, so that --help imports none."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All commands, by group."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command, its module imported; None if there is none such."""
        if cmd_name not in COMMANDS:
            return None
        module, _, function = COMMANDS[cmd_name][0].partition(":")
        return getattr(import_module(f"exodrake.cli.{module}"), function or "command")

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse as click does; the arguments are kept as they were typed, for `command_line`."""
        ctx.meta[ARGUMENTS] = tuple(args)
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Resolve as click does; the error for an unknown command names the nearest ones."""
        name = args[0]
        if not name.startswith("-") and name not in COMMANDS:
            hint = nearest(name, list(COMMANDS)) or "; exodrake --help lists them"
            raise InputProblem(f"no command {name!r}{hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The lists in --help, from the tables alone."""
        for heading, group in GROUPS.items():
            with formatter.section(heading):
                formatter.write_dl([(f"{name:12}", line) for name, (_, line) in group.items()])


@click.group(
    cls=LazyGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, message="exodrake %(version)s")
@click.option(
    "--plugin", multiple=True, metavar="FOLDER", expose_value=False, callback=register_plugins,
    help="Folder of your own machines, effects, parts or file formats. Repeatable.",
)  # fmt: skip
@click.pass_context
def cli(context: click.Context) -> None:
    """Simulate a tendon-driven robot, and explain how far, where and why it differs from the real one.

    `--out` names the folder of a command's files, or the file of one that writes one. `--json` prints the answer of any
    command as JSON, and nothing else. `exodrake COMMAND --help` explains each.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def main() -> None:
    """Run the command of the command line."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a plain-ASCII terminal must not end a run  # pyright: ignore
    cli(prog_name="exodrake")
