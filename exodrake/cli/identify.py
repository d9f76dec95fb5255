"""`exodrake identify`: kinematics from marker recordings, synthetic ones with known truth, and maximum tensions.

`exodrake workspace`: areas that the fingertip reaches. `exodrake fit`: parameters of a robot, fitted to its logs.
"""

from pathlib import Path

import click
from rich.markup import escape

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError


@click.group()
def command() -> None:
    """Find kinematics and maximum tensions from recordings, or make synthetic recordings."""


@options.command(command.command, short_help="Joint axes, centres, angles and phalanx lengths.")
@click.argument("file", type=options.AnyPath())
@click.option("--out", type=options.OutputFolder(), default=Path("kinematics"), show_default=True,
              help="Folder for the files.")  # fmt: skip
@click.option("--markers", "names", type=options.AnyPath(), help="YAML with the marker names of each segment.")
@click.option("--cutoff", type=float, default=4.0, show_default=True,
              help="Smoothing of marker paths [Hz]; 0 for none.")  # fmt: skip
@click.option("--repair", is_flag=True, help="Exchange swapped markers back instead of refusing the file.")
def kinematics(file: Path, out: Path, names: Path | None, cutoff: float, repair: bool) -> object:
    """Joint axes, moving joint centres, angles and phalanx lengths from a marker recording, CSV or C3D.

    Writes kinematics.csv, kinematics.md, kinematics.png and robot.yaml. The recording begins with the finger straight
    and still for 1 s.
    """
    from exodrake.identification.kinematics import identify, markers, report

    recording = markers.read_markers(file)
    layout = markers.read_layout(names) if names else markers.Layout()
    if repair:
        swaps = markers.check_labels(recording, layout).swaps
        recording = markers.exchange_labels(recording, swaps)
        for swap in swaps:
            click.echo(f"exchanged {swap.names[0]} and {swap.names[1]} in frames {swap.first} to {swap.last}")
    with options.waiting("adjusting axes to the markers"):
        found = identify.identify(recording, layout, cutoff or None)
        files = options.write_together(out, report.make_report(found))
    rows = [
        (joint, axis, f"{a} ± {c}", f"{b} ± {d}", rmse) for joint, axis, a, c, b, d, rmse in report.table_rows(found)
    ]
    click.echo(f"joint centres of {Path(found.source).name}: centre = gradient x angle + intercept")
    options.print_table(("joint", "axis", ">gradient \\[mm/rad]", ">intercept \\[mm]", ">RMSE \\[mm]"), rows)
    ranges = ["{:.2f} to {:.2f}".format(*joint.range) for joint in found.joints]
    lengths = [
        (j, span, bone, f"{mm} ± {half}") for span, (j, bone, mm, half) in zip(ranges, report.length_rows(found))
    ]
    options.print_table(("joint", ">flexion \\[rad]", "phalanx", ">length \\[mm]"), lengths)
    for remark in found.remarks:
        click.echo(f"note: {remark}")
    click.echo("wrote " + ", ".join(str(name) for name in files))
    joints = {
        joint.name: {"axis": joint.axis, "half_widths": joint.half_widths, "rmse": joint.rmse, "range": joint.range}
        for joint in found.joints
    }
    lengths = {"lengths": found.lengths, "half_widths": found.intervals}
    return {"source": found.source, "joints": joints, **lengths, "remarks": found.remarks}


@options.command(command.command, short_help="Write a marker recording with known truth.")
@click.argument("file", type=options.OutputFile())
@click.option("--duration", type=float, default=40.0, show_default=True, help="Length of the recording.")
@click.option("--rate", type=float, default=100.0, show_default=True, help="Frames per second.")
@click.option("--noise", type=float, default=0.3, show_default=True, help="Noise per axis [mm RMS].")
@click.option("--artefact", type=float, default=0.0, show_default=True, help="Skin drags each marker [mm/rad].")
@click.option("--dropouts", type=float, default=0.0, show_default=True, help="Gaps per marker and minute.")
@click.option("--swap", nargs=2, help="Two markers that exchange names for half a second in the middle.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
def synthesise(file, duration, rate, noise, artefact, dropouts, swap, seed) -> None:
    """Write a synthetic 14-marker recording, CSV or C3D by its name, and its truth into FILE.truth.yaml."""
    from exodrake.identification.kinematics import markers

    faults = markers.Faults(1e-3 * noise, 1e-3 * artefact, dropouts)
    recording, truth = markers.synthesise(markers.Hand(), faults, duration, rate, seed)
    if swap:
        if len(set(swap) & set(recording.names)) < 2:
            raise InputError(f"--swap {' '.join(swap)}: wanted two of {', '.join(recording.names)}")
        middle = len(recording.time) // 2
        recording = markers.exchange_labels(recording, (markers.Swap(swap, middle, middle + round(rate / 2)),))
    source = f"Synthetic, nobody was measured: exodrake identify synthesise, seed {seed}."
    binary = file.suffix.lower() == ".c3d"
    data = markers.c3d_bytes(recording) if binary else markers.csv_bytes(recording, (source,))
    options.write_files({file: data, file.with_name(file.name + ".truth.yaml"): markers.truth_yaml(truth)})
    click.echo(f"{len(recording.time)} frames, {len(recording.names)} markers")


@options.command(
    command.command, "maximum-tension", short_help="Tension of each tendon beyond which the joints hardly move."
)
@click.argument("log", type=options.AnyPath())
@options.robot_option()
def maximum_tension(log: Path, robot: str) -> object:
    r"""The tension of each tendon that maximises the movement, from LOG of the protocol `maximum-tension`.

    \b
    exodrake simulate maximum-tension --out ramps
    exodrake identify maximum-tension ramps/log.csv
    """
    found = exo.find_maximum_tension(exo.read_log(log), exo.load_robot(robot))
    for one in found:
        moved = ", ".join(f"{joint} {angle:+.2f}" for joint, angle in one.travel.items())
        state = "" if one.saturated else "; the joints still move there"
        click.echo(f"{one.tendon}: {one.tension:.1f} N, moved {moved} rad{state}")
    limits = ", ".join(f"{one.tendon}: {one.tension:.1f}" for one in found)
    click.echo(f"robot file: limits: {{F_max: {{{limits}}}}}")
    return found


@options.command()
@options.robot_option()
@click.option("--out", type=options.OutputFolder(), default=Path("workspace"), show_default=True,
              help="Folder for the files.")  # fmt: skip
@click.option("--samples", type=click.IntRange(100), default=40_000, show_default=True,
              help="Points of the Monte Carlo areas.")  # fmt: skip
@click.option("--steps", type=click.IntRange(3), default=25, show_default=True,
              help="Tensions per tendon in the assisted workspace.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
def find_workspace(robot: str, out: Path, samples: int, steps: int, seed: int) -> object:
    """Areas that fingertip and distal phalanx reach, by polygon union and Monte Carlo.

    Writes workspace.csv and workspace.png; `make paper` compares them with the paper's Table 2.
    """
    from exodrake.identification.workspace import HEAD, SPONTANEOUS, areas, solve_assisted, workspace_figure

    loaded = exo.load_robot(robot)
    options.refuse_others("workspace", loaded, "finger.length")
    lengths = tuple(loaded.channels("finger.length").tolist())
    with options.waiting("sampling postures"):
        wired = solve_assisted(loaded, steps)
        rows = areas(lengths, SPONTANEOUS, wired, samples, seed)
        figure = workspace_figure(lengths, SPONTANEOUS, wired)
    table = "".join(",".join(row) + "\n" for row in (HEAD, *rows))
    files = options.write_together(out, {"workspace.csv": table, "workspace.png": figure})
    marks = [f">{heading}" if "[" in heading else heading for heading in HEAD]
    options.print_table([escape(heading).replace(" \\[", "\n\\[") for heading in marks], rows)
    click.echo("wrote " + ", ".join(str(name) for name in files))
    return [dict(zip(HEAD, [*row[:2], *(float(cell or "nan") for cell in row[2:])])) for row in rows]


@options.command()
@options.CASE
@click.option("--free", multiple=True, required=True, metavar="NAME",
              help="Parameter to fit, such as finger.kappa. Repeatable.")  # fmt: skip
@click.option("--bounds", multiple=True, metavar="NAME=LOW..HIGH",
              help="Range of one, with units or in SI. Repeatable.")  # fmt: skip
@click.option("--held-out", multiple=True, metavar="LOG", help="Log that is not fitted. Repeatable.")
@click.option("--prediction", is_flag=True, help="Fit prediction errors beside output errors.")
@options.robot_option("file")
@options.robot_changes
@click.option("--out", type=options.OutputFolder(), help="Folder for robot.yaml, fit.png and fit.json.")
def fit_parameters(cases, free, bounds, held_out, prediction, file, parameters, effects, parts, out) -> object:
    """Fit parameters of a robot to logs by least squares, with 90 % intervals that allow for coloured residuals.

    CASE_OR_LOG is a case folder, whose held-out logs are held out, or one or several logs. A name without channel
    frees each channel; names in one text, separated by blanks, move together. --effect puts an effect into the robot
    whose parameters may be fitted.
    """
    from exodrake.machines.robot_file import robot_text

    limits = {}
    for text in bounds:
        name, equals, span = text.partition("=")
        low, dots, high = span.partition("..")
        if not equals or not dots:
            raise InputError(f"--bounds: {text!r} is not of the form NAME=LOW..HIGH")
        limits[name.strip()] = (low, high)
    with options.waiting("fitting (the first run after a change compiles for half a minute)"):
        robot = options.change_robot(exo.load_robot(file), parameters, effects, parts)
        found = exo.fit(robot, cases[0] if len(cases) == 1 else cases, free, limits, held_out, prediction)
    for titles, rows in found.tables:
        options.print_table([escape(title).replace("held out, ", "held out\n") for title in titles], rows)
        click.echo()
    for line in (repr(found).splitlines()[-1].strip(), *(f"note: {note}" for note in found.notes)):
        click.echo(line)
    robot_file = robot_text(found.robot, f"{', '.join(free)} fitted to {found.case} by exodrake fit")
    files = {"robot.yaml": robot_file, "fit.png": found.plot()} if out else {}
    return options.write_answer(found.to_dict(), "fit", out, files)
