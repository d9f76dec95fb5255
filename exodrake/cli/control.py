"""`exodrake analyse`: step response, poles, margins, stability map and frequency response of a robot's closed loop.

`exodrake response`: frequency response from a log, between two columns or of every block, beside the robot's.
`exodrake tune`: controllers, tuned within requirements. `exodrake feedforward`: commands that do what is wanted.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError
from exodrake.core.files import is_file
from exodrake.core.schema import read_json

FIGURES = {
    "rise": "s", "overshoot": "%", "settling": "s", "-3 dB": "Hz", "gain\nmargin": "dB", "phase": "deg", "delay": "ms",
    "disk\nmargin": "-",
}  # fmt: skip
ABOVE = click.FloatRange(min=0.0, min_open=True)
SHOWN = 0.3  # poles of smaller modulus are gone within a few frames


@options.command()
@options.robot_changes
@click.option("--at", default="", metavar="AF=4,MF=3,AE=1", help="Operating point: references, or its name: small.")
@click.option("--draws", type=click.IntRange(0, 1000), default=12, help="Robots within the tolerances, for bands. [12]")
@click.option(
    "--diagnosis", type=options.AnyPath(), metavar="FILE|FOLDER",
    help="Answer of `exodrake diagnose --json`, or the folder of one: every robot that it leaves possible.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(0), help="Measure the frequency response with sensor noise of this seed.")
@click.option("--out", type=options.OutputFolder(), help="Folder for figures and analysis.json.")
@click.option(
    "--to-control", "model", type=options.OutputFile(), help="NPZ with A, B, C, D, dt and names for python-control."
)
def analyse_loop(robot, parameters, effects, parts, at, draws, diagnosis, seed, out, model) -> object:
    """How stable, how fast and how robust the closed loop of a robot is, seen once a frame.

    Linearises the whole sampled loop at an operating point, and measures the full nonlinear one by steps and multisine.
    Bands are over robots within the tolerances and over the machine's operating points.
    """
    from exodrake.analysis import closed_loop, figures, limit_cycles, linear_model, robustness
    from exodrake.cli.simulate import warn
    from exodrake.core.parallel import one_blas_thread
    from exodrake.diagnosis.many import ANSWER, IMPROVED
    from exodrake.model.units import quantity
    from exodrake.simulation.protocols import split_options
    from exodrake.simulation.scenario import change_robot

    wanted = click.get_current_context().params["json_file"]
    answer = None
    if diagnosis:  # beside an answer lies its improved robot
        path = diagnosis / ANSWER if diagnosis.is_dir() else diagnosis
        answer, improved = read_json(path), path.with_name(IMPROVED)
        default = click.get_current_context().get_parameter_source("robot") == ParameterSource.DEFAULT
        robot = str(improved) if default and improved.is_file() else robot
    robot, _, _ = change_robot(linear_model.add_controller(exo.load_robot(robot)), parameters, effects, parts)
    point, bands, uncertainty = at.strip() or None, [], None
    if any(mark in at for mark in "=,:"):  # references, not the name of a point
        loop, (_, given) = robot.machine.loop, split_options(f"--at:{at}")
        unit = robot.machine.signal[loop.reference].unit if loop else "-"
        point = {channel: quantity(value, unit, f"--at: {channel}") for channel, value in given.items()}
    with options.waiting("analysing (the first run compiles for half a minute)") as say, one_blas_thread():
        result = exo.analyse(robot, point, seed)
        if draws and robot.machine.tolerances:
            say(f"analysing {draws} robots within the tolerances")
            bands.append(robustness.band("tolerances", robustness.within_tolerances(robot, draws), point))
        if answer is not None:
            say("analysing the robots that the diagnosis leaves possible")
            uncertainty = robustness.assess_answer(robot, answer, point, draws or 12)
            bands.append(uncertainty.band)
        if robot.machine.loop and len(robot.machine.loop.points) > 1:
            say("analysing the operating points")
            bands.append(robustness.points_band(robot))
        result = replace(result, bands=tuple(bands), uncertainty=uncertainty)
        say("predicting limit cycles, and drawing" if out else "predicting limit cycles")
        cycles = limit_cycles.limit_cycles(robot, point) if out or wanted else ()
        drawn, numbers = figures.draw_figures(result, cycles) if out else {}, closed_loop.to_plain(result, cycles)
    show_analysis(result)
    warn(robot)
    if model:
        options.write_files({model: closed_loop.model_bytes(result)})
    return options.write_answer(numbers, "analysis", out, drawn)


def show_analysis(result: exo.ClosedLoop) -> None:
    """The main numbers as tables."""
    rows, poles = [], []
    for step, response, m in zip(result.steps, result.responses, result.margins):
        row = (step.rise, 100.0 * step.overshoot, step.settling, response.bandwidth)
        margin = (m.gain_margin_db, m.phase_margin_deg, 1e3 * m.delay_margin, m.disk_margin)
        cells = [f"{v:.2f}" if result.stable else "-" for v in row]  # a growing oscillation has none
        cells += [f"{v:.3g}" for v in margin]
        rows.append((step.channel, *("-" if cell == "nan" else cell for cell in cells)))
    for pole in result.model.poles():
        if abs(pole.z) >= SHOWN and pole.z.imag >= 0.0:
            place = f"{pole.z.real:+.3f}" + (f" ±{pole.z.imag:.3f}i" if pole.z.imag else "")
            rest = (f"{v:.3g}" for v in (pole.frequency, pole.damping))
            poles.append((f"{abs(pole.z):.4f}", place, *rest, describe_course(pole.time_constant), pole.state))
    options.print_table(("channel", *(f">{name}\n\\[{unit}]" for name, unit in FIGURES.items())), rows)
    click.echo()
    options.print_table((">|z|", ">z", ">frequency\n\\[Hz]", ">damping\n\\[-]", "e-fold\n", "mostly in"), poles)
    names, numbers = ("max sigma(S)", "max sigma(T)", "disk margin"), result.robust.numbers
    if result.robust.stable:
        click.echo("all commands at once: " + ", ".join(f"{n} {numbers[n]:.3g}" for n in names))
    for band in result.bands:  # the least and largest values over each population
        ranges = [(n, band.range(n)) for n in names]
        text = ", ".join(f"{n} {low:.3g} to {high:.3g}" for n, (low, high) in ranges if math.isfinite(low))
        counts = [f"{len(band.members)} {'points' if band.name == 'operating points' else 'robots'}"]
        counts += [f"{band.unstable} unstable"] if band.unstable else []
        counts += [f"{band.undecided} where poles mean little"] if band.undecided else []
        counts += [f"{len(band.failures)} without rest"] if band.failures else []
        click.echo(f"over {band.name} ({', '.join(counts)}): {text or 'no margins'}")
    for line in (*uncertainty_lines(result), verdict(result), *(f"note: {note}" for note in result.notes)):
        click.echo(line)


def describe_course(time_constant: float) -> str:
    """What becomes of a mode, from its time constant [s]; by e in the time that is said."""
    grows = time_constant < 0.0
    return "stays" if math.isinf(time_constant) else f"{'grows' if grows else 'decays'} in {abs(time_constant):.3g} s"


def uncertainty_lines(result: exo.ClosedLoop) -> list[str]:
    """Stability, margins over amplitude, limit cycles, dead band and weight over the robots of a diagnosis."""
    from exodrake.model.display import find_display, shown_unit

    u, machine = result.uncertainty, result.robot.machine
    if u is None:
        return []
    robots, kicked = len(u.band.members), u.band.undecided
    words = f"robots of the diagnosis: {robots - len(u.unstable)} of {robots} stable"
    words += f", {kicked} by a simulated kick" if kicked else ""
    found = [words + (f"; unstable: {', '.join(u.unstable)}" if u.unstable else "")]
    if u.cycles:
        gain, phase = (u.list_worst(name) for name in ("gain_margin_db", "least_phase_deg"))
        found.append(
            f"describing functions, worst amplitude tried, and interval: gain margin {u.gain_margin_db:.3g} dB "
            f"({gain[0].channel}), phase margin {u.phase_margin_deg:.3g} deg ({phase[0].channel})"
        )
        size, frequency = max(c.read_simulation() for c in u.cycles)
        unit, factor = shown_unit(u.cycles[0].unit)
        cycle = f"{factor * size:.3g} {unit} of the command at {frequency:.3g} Hz" if size else "none"
        found.append(f"limit cycle to expect: {cycle}")
    bands = []
    for column in machine.columns:
        shown = find_display(column.kind, machine)
        sizes = [u.dead_band.get(f"{column.kind}_{c}", 0.0) for c in machine.channels(column.signal)]
        bands += [f"{column.kind} ±{shown.factor * max(sizes):.2g} {shown.unit}"] if max(sizes) > 1e-9 else []
    found.append("dead band at rest: " + (", ".join(bands) or "none"))
    text = f"plant within {100.0 * u.deviation.min():.2g} to {100.0 * u.deviation.max():.2g} % of the improved one"
    if math.isfinite(u.peak):
        text += f"; weight times T up to {u.peak:.2g}" + (": stable for all of them" if u.peak < 1.0 else "")
    return [*found, text]


def verdict(result: exo.ClosedLoop) -> str:
    """Stable or not, by the poles, by the simulation where these mean little, and up to which latency."""
    radius, word = result.model.spectral_radius, "stable" if result.stable else "UNSTABLE"
    if not result.model.decides:
        dies = "dies" if result.returns else "does not die"
        return f"{word}: simulated, a kick {dies} out; poles mean little, see note"
    text = f"spectral radius {radius:.4f} per frame: {word}"
    if result.stable and not result.returns:
        text += ", yet a kick does not die out"
    if result.stable and result.latency and math.isfinite(result.latency.limit):
        text += f"; stable up to {result.latency.limit:.2f} frames of added command latency"
    return text


@options.command()
@options.CASE
@click.option("--from", "input", default="", metavar="COLUMN", help="Input, such as tension_AF; else every block.")
@click.option("--to", "output", default="", metavar="COLUMN", help="Output, such as angle_PIP.")
@options.robot_changes
@click.option("--improved", type=options.AnyPath(), metavar="FILE", help="Robot file of an improved robot.")
@click.option("--segment", type=ABOVE, help="Length of Welch's segments [s].")
@click.option("--out", type=options.OutputFolder(), help="Folder for response.png and response.json.")
def find_response(cases, input, output, improved, segment, out, **changes) -> object:
    """Estimate frequency responses from logs, with coherence, and set them beside the robot's on the same references.

    CASE_OR_LOG is a case folder, or one or several logs, which are averaged. Logs without the robot's references are
    estimated alone.
    """
    from exodrake.analysis.log_response import block_responses, plot_responses
    from exodrake.data.case import gather_logs
    from exodrake.model.display import percent

    if bool(input) != bool(output):
        raise InputError("--from and --to belong together; without both, every block is estimated")
    robot = options.load_changed(**changes)
    case = gather_logs(cases[0] if len(cases) == 1 else cases)
    other = exo.load_robot(improved) if improved else None
    follows = all(item.log.has(n) for item in case.logs for n in robot.machine.log_names(robot.machine.references))
    if input and not follows:
        click.echo(f"note: no references of {robot.machine.name} in the logs, so no robot beside them", err=True)
    with options.waiting("simulating on the logs' references, and estimating"):
        if input:
            found = [exo.frequency_response(case, input, output, *((robot, other) if follows else ()), segment=segment)]
        else:
            found = block_responses(case, {"nominal": robot} | ({"improved": other} if other else {}), segment)
    rows, models = [], list(found[0].models) if found else []
    for one in found:
        f = one.frequency[one.band]
        band = f"{f[0]:.3g} to {f[-1]:.3g}" if len(f) else "unresolved"
        gaps = (one.in_words(name) for name in models)
        rows.append((f"{one.input} → {one.output}", band, percent(one.explained), *gaps))
    titles = ("response", ">resolved\n\\[Hz]", ">explained", *(f">measured /\n{name}" for name in models))
    options.print_table(titles, rows)
    if len(found) == 1:
        one, gaps = found[0], [found[0].gap(name) for name in models]
        known, f = one.resolved.nonzero()[0], one.frequency[one.band]
        rounded = [digit * 10.0**power for power in range(-4, 4) for digit in (1, 2, 5)]
        ticks = [tick for tick in rounded if len(f) and f[0] <= tick <= f[-1]]
        rows = []
        for k in sorted({int(known[abs(one.frequency[known] - tick).argmin()]) for tick in ticks}):
            cells = (f"{a[k]:+.1f} dB, {b[k]:+.0f} deg" for a, b in gaps)
            rows.append((f"{one.frequency[k]:.3g}", f"{one.coherence[k]:.2f}", *cells))
        options.print_table((">Hz", ">coherence", *titles[3:]), rows)
    files = {"response.png": plot_responses(found)} if out else {}
    return options.write_answer([one.to_dict() for one in found], "response", out, files)


@options.command()
@options.robot_changes
@click.option("--settling", type=ABOVE, help="Wanted settling time to 2 % [s]; else as short as can be.")
@click.option("--overshoot", type=click.FloatRange(0.0, 100.0), default=5.0, help="Largest overshoot [%]. [5]")
@click.option("--disk-margin", type=click.FloatRange(0.0, 2.0, min_open=True), default=0.6,
              help="Least disk margin, all commands at once. [0.6]")  # fmt: skip
@click.option("--noise", type=ABOVE, help="Largest standard deviation of a command [SI]; else twice today's.")
@click.option("--controller", "only", multiple=True, metavar="NAME", help="Tune this structure only. Repeatable.")
@click.option("--draws", type=click.IntRange(0, 100), default=4,
              help="Robots within tolerances that the search sees. [4]")  # fmt: skip
@click.option("--out", type=options.OutputFolder(), help="Folder for tuned.yaml, tune.png and tune.json.")
@click.option("--out-robot", type=options.OutputFile("tuned.yaml"),
              help="Write the robot with the best controller alone.")  # fmt: skip
def tune_gains(settling, overshoot, disk_margin, noise, only, draws, out, out_robot, **changes) -> Any:
    """Choose the gains of a robot's closed loop that settle fastest within requirements.

    They hold at every operating point of the machine and for robots within the tolerances. Every controller that the
    machine knows is tuned and compared; the fastest that holds all requirements is written as a robot file.
    """
    from exodrake.analysis.figures import plot_tuning
    from exodrake.machines.robot_file import robot_text

    robot = options.load_changed(**changes)
    outer = robot.machine.loop and robot.machine.loop.outer
    if out_robot and outer:
        raise InputError("--out-robot: the gains are those of an outer loop, which no robot file holds")
    wanted = exo.Requirements(settling, overshoot / 100.0, disk_margin, noise)
    with options.waiting("tuning") as say:
        tuning = exo.tune(robot, wanted, only, draws, progress=lambda name: say(f"tuning: {name}"))
    show_tuning(tuning)
    files: dict[str, Any] = {"tune.png": plot_tuning(tuning)} if out else {}
    if (best := tuning.best) and not outer:
        notes = (
            f"controller {best.name} by exodrake tune: overshoot up to {100.0 * wanted.overshoot:g} %, disk margin "
            f"from {wanted.disk_margin:g}; worst over operating points and tolerances: settles in "
            f"{best.settling:.3g} s, overshoot {round(100.0 * best.overshoot, 2):.2g} %, disk margin "
            f"{best.disk_margin:.2g}"
        )
        files["tuned.yaml"] = robot_text(best.robot, notes)
    answer = options.write_answer(tuning.to_dict(), "tune", out, files)
    if out_robot:
        if not best:
            raise InputError("no controller holds all requirements: no robot file written")
        options.write_files({out_robot: files["tuned.yaml"]})
    return answer


def show_tuning(tuning: exo.Tuning) -> None:
    """The controllers as a table, and the best one's gains."""
    from exodrake.analysis.tuning import word_gains
    from exodrake.model.display import shown_unit

    unit, factor = shown_unit(tuning.noise_unit)
    titles = (">settling\n\\[s]", ">overshoot\n\\[%]", ">disk margin\n\\[-]", f">noise\n\\[{unit}]")
    rows = []
    for t in tuning.compared:
        numbers = (f"{t.settling:.3g}", f"{round(100.0 * t.overshoot, 2):.2g}", f"{t.disk_margin:.3g}")
        cells = ("-" if cell == "nan" else cell for cell in (*numbers, f"{factor * t.noise:.3g}"))
        rows.append((t.name, *cells, ", ".join(t.missed)))
    options.print_table(("controller", *titles, "misses"), rows)
    w = tuning.requirements
    click.echo(
        f"required: overshoot up to {100.0 * w.overshoot:g} %, disk margin from {w.disk_margin:g}"
        + (f", noise of a command up to {factor * w.noise:.3g} {unit}" if w.noise is not None else "")
        + (f", settling within {w.settling:g} s" if w.settling is not None else "")
    )
    own, best = tuning.compared[0], tuning.best
    if (limit := tuning.limit) and math.isfinite(limit.settling):
        name = (best or own).name
        click.echo(
            f"bound: on the linear nominal plant without noise, no controller with the commands of {name} settles in "
            f"less than {limit.settling:.3g} s; it settles in {limit.tuned:.3g} s on the nominal robot"
        )
    if limit and limit.law and (p := limit.lqg):
        click.echo(
            f"LQG of {limit.law.nstates} states: settles in {p.settling:.3g} s, overshoot {100.0 * p.overshoot:.2g} %, "
            f"disk margin {p.disk_margin:.3g}, noise {factor * p.noise:.3g} {unit}"
            + (f"; misses: {', '.join(limit.missed)}" if limit.missed else "")
        )
    for note in tuning.notes:
        click.echo(f"note: {note}")
    if best is None:
        click.echo("no controller holds all of them")
        return
    click.echo(f"best: {best.name}, settles in {best.settling:.3g} s ({own.name}: {own.settling:.3g} s)")
    click.echo(f"  {word_gains(best.gains)}")
    for point, (gains, settling) in tuning.schedule.items():
        click.echo(f"  scheduled, {point}: {word_gains(gains)}; settles in {settling:.3g} s")


@options.command()
@click.argument("wanted")
@options.robot_option()
@click.option(
    "--out", required=True, type=options.OutputFile("commands.csv"), help="Log of the commands, or a folder for it."
)
@click.option("--map", "map_file", type=options.AnyPath(), metavar="FILE",
              help="Write them with the names and units of this mapping file, not as a log.")  # fmt: skip
def find_commands(wanted: str, robot: str, out: Path, map_file: Path | None) -> dict[str, Any]:
    """Find the commands with which the robot does what WANTED asks, and write them as a log of references.

    WANTED is a protocol such as random-motion, or a log whose references are what is wanted. With the improved robot of
    a diagnosis, the commands make up for what was found: delay, play, sag, gain.
    """
    from exodrake.analysis.feedforward import feedforward
    from exodrake.cli.logs import owner_table
    from exodrake.data.formats import find_format
    from exodrake.data.import_log import read_mapping
    from exodrake.model.display import find_display

    mapped = read_mapping(map_file) if map_file else None
    if mapped is None:
        find_format(out)
    built = exo.load_robot(robot)
    machine = built.machine
    reference = exo.from_log(wanted, built) if is_file(wanted) else exo.protocol(wanted, built)
    with options.waiting("simulating (the first run after a change compiles for half a minute)"):
        found = feedforward(built, reference)
    log = options.reference_log(built, found.commands, "commands")
    options.write_files({out: log if mapped is None else owner_table(log, mapped, str(map_file))})
    shown = find_display(found.kind, machine)
    ends = [[f"{shown.factor * value:.3g} {shown.unit}" for value in one] for one in (found.before, found.after)]
    rows = list(zip(machine.channels(machine.references[0].signal), *ends, strict=True))
    options.print_table(("channel", ">RMS error if sent as wanted", ">with these commands"), rows)
    click.echo("the errors are those of the model")
    return {"kind": found.kind, "before": found.before, "after": found.after}
