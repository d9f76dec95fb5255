"""`exodrake simulate`: a robot on a protocol; its log, scenario, figure and a recording to look at. `warm-up`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from exodrake.cli.options import OutputFolder, print_table, robot_changes, robot_option, waiting
from exodrake.core.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from exodrake.compiled.inputs import Reference
    from exodrake.core.robot import Robot
    from exodrake.data.log import Log
    from exodrake.simulation.scenario import Scenario


@click.command()
@click.argument("protocol", required=False, default="")
@click.option("--reference", default="", metavar="LOG", help="Follow the references of this log.")
@click.option("--scenario", "file", default="", metavar="FILE", help="Repeat this scenario; other options change it.")
@robot_option(default="")
@robot_changes
@click.option("--seed", type=int, default=None, help="Seed of the noise [0].")
@click.option("--no-noise", is_flag=True, help="Sensors without noise, a bus that loses nothing.")
@click.option("--no-quantisation", is_flag=True, help="Readings unrounded.")
@click.option(
    "--engine", default="", metavar="NAME", help="compiled (the default) or drake: the same log to the last bit."
)
@click.option("--out", type=OutputFolder(), default=None, help="Folder for the files [simulated/PROTOCOL].")
def command(protocol: str, reference: str, file: str, robot: str, out: Path | None, **options) -> None:
    """Run a robot on PROTOCOL and write log.csv, scenario.yaml, figure.png and recording.html.

    With --effect, --set, --part or a robot file the nominal robot runs beside it: nominal.csv, dotted in the figure, a
    grey ghost in the recording.

    PROTOCOL is a grasp mode (caging, narrow-pinch, wide-pinch) or one of sweeps, short-sweeps, chirp, holds, steps,
    multisine, random-motion, maximum-tension. Options of its own follow a colon: `caging:hold=4`,
    `chirp:low=0.1,high=1.5`. For a wide pinch that bends the PIP by 0.4 rad: `--robot exo_index/wide_pinch`.
    """
    from exodrake.core.files import check_folder, write_folder
    from exodrake.data.log_file import log_bytes

    scenario, built = changed(scenario_of(protocol, reference, file, robot), options)
    what = scenario.build_reference(built)
    folder = out or Path("simulated") / what.name
    check_folder(folder)
    with waiting("simulating") as say:
        log, nominal = scenario.simulate(built, what), nominal_of(scenario, built, what)
        logs = {"log.csv": log} if nominal is None else {"log.csv": log, "nominal.csv": nominal}
        contents = {name: log_bytes(one, folder / name) for name, one in logs.items()}
        contents |= files_of(scenario, built, log, what.name, say, nominal)
        write_folder(folder, contents)
    print_run(scenario, built, log, nominal)
    click.echo(f"wrote {folder}/: {', '.join(contents)}")
    warn(built)


def scenario_of(protocol: str, reference: str, file: str, robot: str) -> Scenario:
    """The scenario that the first four options ask for; those given replace the file's."""
    from exodrake.simulation.scenario import Scenario, embedded, read_scenario

    if protocol and reference:
        raise InputError("both a protocol and --reference: wanted one of them")
    if not (protocol or reference or file):
        raise InputError("nothing to follow: name a protocol or grasp mode (see --help), a --reference or a --scenario")
    if not file:
        there = Scenario(protocol, reference)
    else:
        there = read_scenario(file)
        if protocol or reference:
            there = replace(there, protocol=protocol, reference=reference)
    return replace(there, robot=embedded(robot)) if robot else there


def changed(scenario: Scenario, options: dict) -> tuple[Scenario, Robot]:
    """The scenario with options applied in the order variants, parameters, effects, and its robot."""
    from exodrake.simulation.scenario import parse_effect, parse_number

    if options["seed"] is not None:
        scenario = replace(scenario, seed=options["seed"])
    if options["no_noise"]:
        scenario = replace(scenario, seed=None)
    if options["no_quantisation"]:
        scenario = replace(scenario, quantisation=False)
    if options["engine"]:
        scenario = replace(scenario, engine=options["engine"])
    scenario = replace(scenario, parts=list(dict.fromkeys([*scenario.parts, *options["parts"]])))
    robot = scenario.build_robot()
    parameters = dict(parse_number(text, robot) for text in options["parameters"])
    scenario = replace(scenario, parameters={**scenario.parameters, **parameters})
    for text in options["effects"]:
        identity, given = parse_effect(text, scenario.build_robot())
        scenario = replace(scenario, effects={**scenario.effects, identity: given})
    return scenario, scenario.build_robot()


def nominal_of(scenario: Scenario, robot: Robot, what: Reference) -> Log | None:
    """Log of the same run of the nominal robot: without the options, and in place of a robot file; None if it is it."""
    own = not isinstance(scenario.robot, str)
    if not (scenario.effects or scenario.parameters or scenario.parts or own):
        return None
    name = robot.machine.name if own else scenario.robot
    plain = replace(scenario, robot=name, effects={}, parameters={}, parts=())
    return plain.simulate(plain.build_robot(), what)


def files_of(
    scenario: Scenario, robot: Robot, log: Log, name: str, say: Callable[[str], None], nominal: Log | None = None
) -> dict[str, bytes]:
    """Contents of all files but the logs. A scenario that followed a log refers to the log written beside it."""
    from exodrake.data.compare import compare, remarks
    from exodrake.data.plot import png_of
    from exodrake.diagrams.meshcat import recording_html
    from exodrake.simulation.scenario import scenario_text

    again = replace(scenario, reference="log.csv") if scenario.reference else scenario
    title, details, machine = name.replace("-", " "), changes(scenario, robot), robot.machine
    said = remarks(compare(nominal, log), log, machine) if nominal is not None else {}
    say("drawing the figure")
    names = ("this run", "nominal")
    figure = log.plot(title, nominal, names, machine=machine, details=["; ".join(details)], remarks=said)
    files = {"scenario.yaml": scenario_text(again).encode(), "figure.png": png_of(figure)}
    if machine.skeleton is not None:
        say("drawing the recording")
        html = recording_html(log, robot, title, other=nominal, names=names, details=details)
        files["recording.html"] = html.encode()
    return files


def changes(scenario: Scenario, robot: Robot) -> list[str]:
    """Differences from a plain run of the nominal robot: effects with values, parameters, variants, options."""
    from exodrake.core.display import in_words
    from exodrake.core.robot import effect_in_words

    said = [effect_in_words(robot, identity) for identity in robot.effects()]
    for name in scenario.parameters:
        values = sorted({float(robot.values[i]) for i in robot.indices(name)})
        unit = robot.machine.parameters[robot.indices(name)[0]].unit
        said.append(f"{name} = {' and '.join(in_words(value, unit) for value in values)}")
    said += robot.machine.variant_names
    _, _, options = scenario.protocol.partition(":")
    said += [option.replace("=", " = ") for option in filter(None, options.split(","))]
    said += ["no noise"] if scenario.seed is None else [f"seed {scenario.seed}"] * (scenario.seed != 0)
    said += ["readings unrounded"] * (not scenario.quantisation) + ["in Drake"] * (scenario.engine == "drake")
    return said


def print_run(scenario: Scenario, robot: Robot, log: Log, nominal: Log | None) -> None:
    """Prints what ran, and for each channel its range and its errors from reference and nominal run."""
    import numpy as np
    from rich.markup import escape

    from exodrake.core.display import display_of

    machine, rows, peak = robot.machine, [], turning_point(robot, log)
    for column in (column for column in machine.columns if column not in machine.references):
        display = display_of(column.kind, machine)
        for channel in machine.channels(column.signal):
            name, reference = f"{column.kind}_{channel}", f"{column.kind}_ref_{channel}"
            values = display.factor * log[name]
            cells = [values.min(), values.max(), *([] if peak is None else [values[peak]]), values[-1]]
            for other, wanted in [(log, reference), *([] if nominal is None else [(nominal, name)])]:
                known = other.has(wanted)
                cells.append(np.sqrt(np.mean((values - display.factor * other[wanted]) ** 2)) if known else np.nan)
            texts = ["" if np.isnan(cell) else f"{float(cell):.3g}" for cell in cells]
            rows.append((f"{column.kind} {channel}".rstrip(), escape(display.unit), *texts))
    titles = ["signal", "unit", ">lowest", ">highest", *([] if peak is None else [f">at\n{log.time[peak]:.2f} s"])]
    titles += [">in the\nend", ">RMS from\nreference", *([">RMS from\nnominal"] if nominal is not None else [])]
    click.echo(f"{log.label}  {log.duration:g} s, {len(log)} rows")
    for change in changes(scenario, robot):
        click.echo(f"with {change}")
    print_table(titles, rows)
    if peak is not None:
        click.echo(f"{log.time[peak]:.2f} s: the last moment at which the references are farthest from their start")


def turning_point(robot: Robot, log: Log) -> int | None:
    """Last row in which the references are as far from their start as they go; None where they do not move."""
    import numpy as np

    kind = robot.machine.references[0].kind
    away: np.ndarray = np.linalg.norm(log[kind] - log[kind][0], axis=1) if log.has(kind) else np.zeros(len(log))
    far = np.flatnonzero(away >= away.max() * (1.0 - 1e-9))
    return int(far[-1]) if away.max() > 0.0 else None


def warn(robot: Robot) -> None:
    """Says which parameters, and values of effects, lie outside their plausible range."""
    from exodrake.core.robot import implausible

    for sentence in implausible(robot):
        click.secho(f"note: {sentence}", fg="yellow", err=True)


@click.command()
def compile_kernels() -> None:
    """Compile the nominal robot's simulation into numba's cache; later sessions load it in a second or two."""
    from time import perf_counter

    from exodrake.simulation.warm_up import JOBS, warm_up

    start = perf_counter()
    with waiting(f"compiling {', '.join(JOBS)}") as say:
        warm_up(lambda done, left: say(f"compiled {done}; still {', '.join(left) or 'nothing'}"))
    click.echo(f"compiled {', '.join(JOBS)} in {perf_counter() - start:.0f} s")
