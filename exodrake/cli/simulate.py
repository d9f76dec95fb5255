"""`exodrake simulate`: a robot on a protocol; its log, scenario, figure and a recording to look at. `warm-up`.

`exodrake sweep`: many runs of a robot over its parameters, tolerances or a diagnosis, as a table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click
from rich.markup import escape

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError
from exodrake.core.files import check_folder, is_file
from exodrake.core.progress import show_count
from exodrake.core.schema import read_json, read_yaml

if TYPE_CHECKING:
    from exodrake.simulation.scenario import Scenario


@options.command()
@click.argument("protocol", required=False, default="")
@click.option("--reference", default="", metavar="LOG", help="Follow the references of this log.")
@click.option("--scenario", "file", default="", metavar="FILE", help="Repeat this scenario; other options change it.")
@partial(options.robot_changes, default="")
@click.option("--seed", type=int, help="Seed of the noise [0].")
@click.option("--no-noise", is_flag=True, help="Sensors without noise, a bus that loses nothing.")
@click.option("--no-quantisation", is_flag=True, help="Readings unrounded.")
@click.option("--engine", default="", metavar="NAME", help="compiled (default) or drake: the same log to the last bit.")
@click.option("--out", type=options.OutputFolder(), help="Folder for the files [simulated/PROTOCOL].")
def command(protocol: str, reference: str, file: str, robot: str, out: Path | None, **changed) -> object:
    """Run a robot on PROTOCOL and write log.csv, scenario.yaml, figure.png and recording.html.

    With --effect, --set, --part or a robot file the nominal robot runs beside it: nominal.csv, dotted in the figure, a
    grey ghost in the recording.

    PROTOCOL is a grasp mode (caging, narrow-pinch, wide-pinch) or one of sweeps, short-sweeps, chirp, holds, steps,
    multisine, random-motion, maximum-tension. Options of its own follow a colon: `caging:hold=4`,
    `chirp:low=0.1,high=1.5`. For a wide pinch that bends the PIP by 0.4 rad: `--robot exo_index/wide_pinch`.
    """
    import numpy as np

    from exodrake.model.display import find_display

    scenario = scenario_from(protocol, reference, file, robot, **changed)
    built = scenario.build_robot()
    what = scenario.build_reference(built)
    folder = out or Path("simulated") / what.name
    check_folder(folder)
    with options.waiting("simulating") as say:
        log, nominal = scenario.simulate(built, what), None
        own = not isinstance(scenario.robot, str)
        if scenario.effects or scenario.parameters or scenario.parts or own:  # beside the robot without them
            name = built.machine.name if own else scenario.robot
            plain = replace(scenario, robot=name, effects={}, parameters={}, parts=())
            nominal = plain.simulate(plain.build_robot(), what)
        contents = {"log.csv": log} if nominal is None else {"log.csv": log, "nominal.csv": nominal}
        contents |= make_files(scenario, built, log, what.name, say, nominal)
        options.write_together(folder, contents)
    machine, signals, rows, peak = built.machine, {}, [], None
    kind = machine.references[0].kind
    if log.has(kind) and (away := np.linalg.norm(log[kind] - log[kind][0], axis=1)).max() > 0.0:
        peak = int(np.flatnonzero(away >= away.max() * (1.0 - 1e-9))[-1])  # the last row farthest from the start
    for column in (column for column in machine.columns if column not in machine.references):
        display = find_display(column.kind, machine)
        for channel in machine.channels(column.signal):
            name, reference = f"{column.kind}_{channel}", f"{column.kind}_ref_{channel}"
            values = log[name]
            one = {"lowest": values.min(), "highest": values.max()}
            one |= {} if peak is None else {"at_peak": values[peak]}
            one["end"] = values[-1]
            for key, other, wanted in (("reference", log, reference), ("nominal", nominal, name)):
                if other is not None:
                    known = other.has(wanted)
                    one[f"rms_from_{key}"] = np.sqrt(np.mean((values - other[wanted]) ** 2)) if known else np.nan
            signals[name] = {"unit": log.units[name], **one}
            texts = ["" if np.isnan(cell) else f"{float(display.factor * cell):.3g}" for cell in one.values()]
            rows.append((f"{column.kind} {channel}".rstrip(), escape(display.unit), *texts))
    titles = ["signal", "unit", ">lowest", ">highest", *([] if peak is None else [f">at\n{log.time[peak]:.2f} s"])]
    titles += [">in the\nend", ">RMS from\nreference", *([">RMS from\nnominal"] if nominal is not None else [])]
    click.echo(f"{log.label}  {log.duration:g} s, {len(log)} rows")
    for change in changes(scenario, built):
        click.echo(f"with {change}")
    options.print_table(titles, rows)
    if peak is not None:
        click.echo(f"{log.time[peak]:.2f} s: the last moment at which the references are farthest from their start")
    click.echo(f"wrote {folder}/: {', '.join(contents)}")
    warn(built)
    answer = {"out": folder, "files": list(contents), "duration": log.duration, "rows": len(log)}
    return answer | {"changes": changes(scenario, built), "signals": signals}


def scenario_from(
    protocol: str, reference: str, file: str, robot: str, parameters: tuple[str, ...], effects: tuple[str, ...],
    parts: tuple[str, ...], seed: int | None, no_noise: bool, no_quantisation: bool, engine: str,
) -> Scenario:  # fmt: skip
    """The scenario of the options; those given replace the file's, in the order variants, parameters, effects."""
    from exodrake.simulation.scenario import Scenario, change_robot, read_scenario

    if protocol and reference:
        raise InputError("both a protocol and --reference: wanted one of them")
    if not (protocol or reference or file):
        raise InputError("nothing to follow: name a protocol or grasp mode (see --help), a --reference or a --scenario")
    scenario = read_scenario(file) if file else Scenario(protocol, reference)
    given: dict[str, Any] = {"protocol": protocol, "reference": reference} if protocol or reference else {}
    if robot:
        exo.load_robot(robot)
        given["robot"] = read_yaml(robot) if is_file(robot) else robot  # so that the scenario stands alone
    given |= {"seed": None if no_noise else seed} if seed is not None or no_noise else {}
    given |= {"quantisation": False} if no_quantisation else {}
    given |= {"engine": engine} if engine else {}
    scenario = replace(scenario, parts=list(dict.fromkeys([*scenario.parts, *parts])), **given)
    _, numbers, spliced = change_robot(scenario.build_robot(), parameters, effects)
    numbers, spliced = {**scenario.parameters, **numbers}, {**scenario.effects, **spliced}
    return replace(scenario, parameters=numbers, effects=spliced)


def make_files(
    scenario: Scenario, robot: exo.Robot, log: exo.Log, name: str, say: Callable[[str], None],
    nominal: exo.Log | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Contents of all files but the logs. A scenario that followed a log refers to the log written beside it."""
    from exodrake.data.plot import remarks
    from exodrake.diagrams.meshcat import recording_html
    from exodrake.simulation.scenario import scenario_text

    again = replace(scenario, reference="log.csv") if scenario.reference else scenario
    title, details, machine = name.replace("-", " "), changes(scenario, robot), robot.machine
    said = remarks(exo.compare(nominal, log), log, machine) if nominal is not None else {}
    say("drawing the figure")
    names = ("this run", "nominal")
    figure = log.plot(title, nominal, names, machine=machine, details=["; ".join(details)], remarks=said)
    files = {"scenario.yaml": scenario_text(again), "figure.png": figure}
    if machine.skeleton is not None:
        say("drawing the recording")
        files["recording.html"] = recording_html(log, robot, title, other=nominal, names=names, details=details)
    return files


def changes(scenario: Scenario, robot: exo.Robot) -> list[str]:
    """Differences from a plain run of the nominal robot: effects with values, parameters, variants, options."""
    from exodrake.model.display import in_words
    from exodrake.model.robot import effect_in_words

    said = [effect_in_words(robot, identity) for identity in robot.effects()]
    for name in scenario.parameters:
        values = sorted({float(robot.values[i]) for i in robot.indices(name)})
        unit = robot.machine.parameters[robot.indices(name)[0]].unit
        said.append(f"{name} = {' and '.join(in_words(value, unit) for value in values)}")
    said += robot.machine.variant_names
    _, _, tail = scenario.protocol.partition(":")
    said += [option.replace("=", " ") for option in filter(None, tail.split(","))]
    said += ["no noise"] if scenario.seed is None else [f"noise of seed {scenario.seed}"] * (scenario.seed != 0)
    said += ["readings unrounded"] * (not scenario.quantisation) + ["in Drake"] * (scenario.engine == "drake")
    return said


def warn(robot: exo.Robot) -> None:
    """Says which parameters, and values of effects, lie outside their plausible range."""
    from exodrake.model.robot import implausible

    for sentence in implausible(robot):
        click.secho(f"note: {sentence}", fg="yellow", err=True)


@options.command()
def compile_kernels() -> None:
    """Compile the nominal robot's simulation into numba's cache; later sessions load it in a second or two."""
    from exodrake.core.parallel import each
    from exodrake.engine.compose import compile_machine
    from exodrake.simulation.simulate import ENGINES

    start = perf_counter()
    with options.waiting("compiling the simulator and the Drake leaves"):
        compile_machine(exo.load_robot().machine)  # writes the module, once for all processes
        for outcome in each(use_engine, ((engine,) for engine in ENGINES), jobs=len(ENGINES)):
            if outcome.reason:
                raise RuntimeError(f"engine {ENGINES[outcome.number]}: {outcome.reason}\n{outcome.trace}")
    click.echo(f"compiled the simulator and the Drake leaves in {perf_counter() - start:.0f} s")


def use_engine(engine: str) -> None:
    """Uses once all that an engine compiles."""
    import numpy as np

    exo.record(exo.load_robot(), exo.Reference(np.tile([5.0, 3.0, 1.0], (3, 1)), "warm-up"), engine=engine)


@options.command()
@click.argument("protocol", required=False, default="")
@click.option("--reference", default="", metavar="LOG", help="Follow the references of this log instead.")
@click.option("--over", multiple=True, metavar="NAME=VALUES",
              help="0.1,0.2,0.4 or 0.1:0.4:7 (low, high, count). Repeatable: a grid.")  # fmt: skip
@click.option("--robots", type=click.IntRange(1), help="So many robots within the tolerances.")
@click.option("--diagnosis", type=options.AnyPath(), metavar="FILE", help="Robots within its intervals.")
@options.robot_changes
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the draws. [0]")
@click.option("--noise", type=click.IntRange(0), help="Seed of the sensors' noise; none without it.")
@click.option("--out", type=options.OutputFolder(), help="Folder for sweep.csv, sweep.png and sweep.json.")
def sweep_parameters(protocol, reference, over, robots, diagnosis, seed, noise, out, **changes) -> Any:
    """Run a robot on PROTOCOL once for each variation, and tabulate RMS from the robot's own run, peak and end."""
    import numpy as np

    from exodrake.analysis.sweep import plot_sweep

    if bool(protocol) == bool(reference) or bool(over) + bool(robots) + bool(diagnosis) != 1:
        raise InputError("wanted a protocol or --reference, and one of --over, --robots and --diagnosis")
    robot, grid = options.load_changed(**changes), {}
    for text in over:
        name, equals, values = text.partition("=")
        try:
            ends = values.split(":")
            if not name or not equals or len(ends) not in (1, 3):
                raise ValueError
            grid[name.strip()] = (
                np.linspace(float(ends[0]), float(ends[1]), int(ends[2])) if len(ends) == 3 else values.split(",")
            )
        except ValueError:
            raise InputError(f"--over: {text!r} is not NAME=VALUE,VALUE nor NAME=LOW:HIGH:COUNT") from None
    what = grid or robots or read_json(diagnosis)
    with show_count("runs", "the table is written at the end") as count:
        followed = exo.from_log(reference, robot) if reference else protocol
        found = exo.sweep(robot, what, followed, seed=seed, noise=noise, progress=count)
    numbers = found.describe().T[["mean", "std", "min", "max"]]
    rows = [(name, *(f"{x:.4g}" for x in row), found.attrs["units"].get(name, "")) for name, row in numbers.iterrows()]
    options.print_table(("", ">mean", ">std", ">least", ">largest", "unit"), rows)
    files = {"sweep.csv": found.to_csv(index=False), "sweep.png": plot_sweep(found)} if out else {}
    answer = {"units": found.attrs["units"], "rows": found.to_dict("records")}
    return options.write_answer(answer, "sweep", out, files)
