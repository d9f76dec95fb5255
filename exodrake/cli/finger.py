"""The finger of the paper: `exodrake identify` finds its kinematics and maximum tensions, `workspace` what it reaches.

`exodrake train` and `estimate`: its joint angles from stroke and tension. `exodrake grasp`: tensions for an object.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.markup import escape

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError
from exodrake.core.files import check_folder

BAND = "black: estimate, with a band of two standard deviations; in colour: measured"
ESTIMATOR = "estimator.npz"
RECORDINGS = {  # name -> posture that it shows, and the columns that it is in
    "recording.html": ("reached", "angle"),
    "estimated.html": ("estimated", "angle_est"),
    "planned.html": ("planned", "angle_plan"),
}
WIDTH = 0.04  # m, of a caged cylinder across the finger in the recording


@click.group()
def identify_finger() -> None:
    """Find kinematics and maximum tensions from recordings, or make synthetic recordings."""


@options.command(identify_finger.command, short_help="Joint axes, centres, angles and phalanx lengths.")
@click.argument("file", type=options.AnyPath())
@options.option("--out", type=options.OutputFolder(), default=Path("kinematics"), help="Folder for the files.")
@click.option("--markers", "names", type=options.AnyPath(), help="YAML with the marker names of each segment.")
@options.option("--cutoff", default=4.0, help="Smoothing of marker paths [Hz]; 0 for none.")
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
    click.echo(f"joint centres of {Path(found.source).name}: centre = gradient x angle + intercept")
    rows = [(j, axis, f"{a} ± {c}", f"{b} ± {d}", rmse) for j, axis, a, c, b, d, rmse in report.table_rows(found)]
    options.print_table(("joint", "axis", ">gradient \\[mm/rad]", ">intercept \\[mm]", ">RMSE \\[mm]"), rows)
    flexions = ["{:.2f} to {:.2f}".format(*joint.range) for joint in found.joints]
    rows = [(j, span, bone, f"{mm} ± {c}") for span, (j, bone, mm, c) in zip(flexions, report.length_rows(found))]
    options.print_table(("joint", ">flexion \\[rad]", "phalanx", ">length \\[mm]"), rows)
    for remark in found.remarks:
        click.echo(f"note: {remark}")
    click.echo("wrote " + ", ".join(str(name) for name in files))
    joints = {
        joint.name: {"axis": joint.axis, "half_widths": joint.half_widths, "rmse": joint.rmse, "range": joint.range}
        for joint in found.joints
    }
    answer = {"source": found.source, "joints": joints, "lengths": found.lengths, "half_widths": found.intervals}
    return answer | {"remarks": found.remarks}


@options.command(identify_finger.command, short_help="Write a marker recording with known truth.")
@click.argument("file", type=options.OutputFile())
@options.option("--duration", default=40.0, help="Length of the recording.")
@options.option("--rate", default=100.0, help="Frames per second.")
@options.option("--noise", default=0.3, help="Noise per axis [mm RMS].")
@options.option("--artefact", default=0.0, help="Skin drags each marker [mm/rad].")
@options.option("--dropouts", default=0.0, help="Gaps per marker and minute.")
@click.option("--swap", nargs=2, help="Two markers that exchange names for half a second in the middle.")
@options.option("--seed", type=click.IntRange(0), default=0, help="Seed of noise and gaps.")
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
    identify_finger.command, "maximum-tension", short_help="Tension of each tendon beyond which the joints hardly move."
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
@options.option("--out", type=options.OutputFolder(), default=Path("workspace"), help="Folder for the files.")
@options.option("--samples", type=click.IntRange(100), default=40_000, help="Points of the Monte Carlo areas.")
@options.option("--steps", type=click.IntRange(3), default=25, help="Tensions per tendon in the assisted workspace.")
@options.option("--seed", type=click.IntRange(0), default=0, help="Seed of the Monte Carlo points.")
def find_workspace(robot: str, out: Path, samples: int, steps: int, seed: int) -> object:
    """Areas that fingertip and distal phalanx reach, by polygon union and Monte Carlo.

    Writes workspace.csv and workspace.png; `make paper` compares them with the paper's Table 2.
    """
    import matplotlib

    from exodrake.data.plot import STYLE
    from exodrake.identification.workspace import HEAD, SPONTANEOUS, areas, solve_assisted, workspace_figure

    loaded = exo.load_robot(robot)
    options.refuse_others("workspace", loaded)
    lengths = tuple(loaded.channels("finger.length").tolist())
    with options.waiting("sampling postures"), matplotlib.rc_context(STYLE):
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
@click.argument("logs", nargs=-1, required=True, type=options.AnyPath())
@click.option("--out", required=True, type=options.OutputFile("estimator.npz"), help="Estimator file, or a folder.")
@options.option("--points", default=500, type=click.IntRange(50, 4000), help="Training points, equispaced.")
@click.option("--robot", default="", metavar="FILE", help="Robot file or machine whose signature to record.")
@click.option("--one-sweep-per-log", is_flag=True, help="Do not cut logs at the ramps of their tension references.")
@options.option("--seed", default=0, help="Seed of the validation's folds.")
def train_estimator(logs, out, points, robot, one_sweep_per_log, seed) -> object:
    """Train the joint-angle estimator on LOGS (tension, stroke and measured angles).

    Prints the error on random rows beside that on whole held-out sweeps; only the second predicts a new sweep.
    """
    from exodrake.core.provenance import robot_digest
    from exodrake.estimator import dataset, gp, validate

    mark = robot_digest(exo.load_robot(robot)) if robot else ""
    read = [exo.read_log(path, ("tension_ref", "tension", "stroke")) for path in logs]
    sweeps = dataset.sweeps_from_logs(read, one_per_log=[log.label for log in read] if one_sweep_per_log else ())
    with options.waiting("learning") as say:
        prior = gp.learn(sweeps, points)
        estimator = replace(gp.condition(prior, sweeps, points), robot=mark, strokes=gp.learn_strokes(sweeps))
        say("validating on held-out sweeps")
        scores = validate.validate(prior, sweeps, points, seed)
    notes = {f"{s.method}, {s.split}": [float(value) for value in s.rmse] for s in scores}
    options.write_files({out: gp.estimator_bytes(estimator, notes)}, announce=False)
    splits, rows = list(dict.fromkeys(score.split for score in scores)), []
    for method in dict.fromkeys(score.method for score in scores):
        own = [next(s for s in scores if (s.method, s.split) == (method, split)) for split in splits]
        rows.append((method, "RMSE, mean, rad", *(f"{score.mean_rmse:.4f}" for score in own)))
        joints = "/".join(estimator.joints)
        for name, digits, found in ((joints, 4, [s.rmse for s in own]), ("inside 95 %", 2, [s.coverage for s in own])):
            cells = (" / ".join("-" if v != v else f"{v:.{digits}f}" for v in values) for values in found)
            rows.append(("", name, *cells))
    click.echo("estimator and baselines by split: a new sweep is like the right column")
    options.print_table(("method", "figure", *(f">{split}" for split in splits)), rows)
    click.echo(f"wrote {out}: {estimator.points} points of {estimator.sweeps} sweeps in {len(read)} log(s)")
    return {"joints": estimator.joints, "rmse": notes}


@options.command()
@click.argument("log", type=options.AnyPath())
@click.option("--estimator", required=True, type=options.AnyPath(), help="File written by `exodrake train`.")
@click.option("--out", type=options.OutputFile("estimated.csv"),
              help="Write the log with angle_est and angle_std columns; its figure lies beside.")  # fmt: skip
@click.option("--robot", default="", metavar="FILE", help="Robot file or machine that the estimator must belong to.")
@click.option("--as-trained", is_flag=True, help="Keep the zeros of the training, even if those of LOG have moved.")
def estimate_angles(log, estimator, out, robot, as_trained) -> object:
    """Joint angles of LOG with their standard deviations, and the share of samples unlike the training sweeps.

    Tests whether the zeros of the strokes have moved since the training, as re-donning does, and corrects them. Where
    LOG has measured angles, prints the error and the share inside the 95 % interval.
    """
    from exodrake.core.provenance import robot_digest
    from exodrake.estimator import gp, validate

    trained = gp.load(estimator, robot_digest(exo.load_robot(robot)) if robot else None)
    found = validate.estimate(trained, exo.read_log(log, ("tension", "stroke")), correct=not as_trained)
    if out:
        figure = out.with_name(out.name.split(".")[0] + ".png")
        drawn = found.log.plot(f"{log.name}, estimated", details=[BAND])
        options.write_files({out: found.log, figure: drawn}, announce=False)
        click.echo(f"{out}: {len(found.log)} rows with angle_est and angle_std")
        click.echo(f"{figure}: the log with its estimate")
    if zeros := found.zeros:
        parts = zip(zeros.wires, 1e3 * zeros.shift, 1e3 * zeros.half_widths, strict=True)
        shifts = ", ".join(f"{wire} {shift:+.2f} ± {half:.2f}" for wire, shift, half in parts)
        text = f"zeros of the strokes since the training: {shifts} mm"
        if zeros.unlike:
            text += "\nand more than a shift: contact, other tensions, another wearer or robot? Nothing corrected."
        elif zeros.moved:
            done = "not corrected, by --as-trained" if as_trained else "corrected"
            text += f": moved, {done}. Re-donned? A changed rest posture looks the same."
        else:
            text += ": not moved"
        click.echo(text)
    click.echo(f"unlike the training sweeps: {100 * found.flagged:.1f} % of samples")
    if found.flagged > 0.5:
        click.echo("most samples are: other tensions, another wearer or robot? Train again before trusting the angles.")
    answer = {"joints": trained.joints, "flagged": found.flagged, "zeros": found.zeros, "score": found.score}
    if found.score is None:
        click.echo("no measured angles in this log: error unknown")
        return answer
    for joint, rmse, coverage in zip(trained.joints, found.score.rmse, found.score.coverage, strict=True):
        click.echo(f"{joint}: RMSE {rmse:.4f} rad, {100 * coverage:.1f} % inside the 95 % interval")
    return answer


@options.command()
@click.argument("mode")
@click.option("--size", required=True, metavar="SIZE", help="Diameter of the object with its unit: 60mm, '6 cm'.")
@click.option("--estimator", "file", type=options.AnyPath(), help="File of `exodrake train`.")
@options.robot_option()
@options.option("--seed", type=click.IntRange(0), default=0, help="Seed of the noise.")
@click.option("--out", type=options.OutputFolder(), help="Folder for the files [grasps/MODE-SIZE].")
def plan_grasp(mode: str, size: str, file: Path | None, robot: str, seed: int, out: Path | None) -> Any:
    """Plan a grasp (caging, narrow-pinch, wide-pinch), simulate it, and show planned, reached and estimated posture.

    Writes log.csv, plan.json, figure.png, Meshcat recordings (recording.html as reached, estimated.html, planned.html)
    and, without --estimator, the estimator.npz it trained. For a grasp out of reach the nearest one that the tendons
    hold is shown.
    """
    import numpy as np

    from exodrake.diagrams import meshcat
    from exodrake.estimator import gp
    from exodrake.grasping.plan import at_hold, grasp_figure, run_plan

    built, wanted = exo.load_robot(robot), parse_size(size)
    options.refuse_others("grasp", built)
    listening = gp.load(file) if file else None
    with options.waiting("planning (the statics compile first)") as say:
        plan = exo.plan_grasp(mode, wanted, built)
        folder = out or Path("grasps") / f"{plan.mode}-{1e3 * plan.size:g}mm"
        check_folder(folder)
        if listening is None:
            say("training an estimator on simulated sweeps")
            listening = gp.quick_estimator(built.without_effects(), folder / ESTIMATOR)
        say("simulating the Diagram")
        log = run_plan(plan, built, listening, seed)
        say("drawing")
        width = WIDTH if plan.mode == "caging" else None
        thing = meshcat.Thing((plan.centre[0], -plan.centre[1]), plan.size / 2.0, width)
        shown = log.with_array("angle_plan", plan.joints, np.tile(plan.planned, (len(log), 1)))
        contents: dict[str, Any] = {"log.csv": log, "plan.json": options.json_text(plan)}
        contents["figure.png"] = grasp_figure(plan, log, built)
        for name, (what, kind) in RECORDINGS.items():
            title = f"{plan.mode.replace('-', ' ').capitalize()}, {1e3 * plan.size:g} mm, {what}"
            contents[name] = meshcat.recording_html(shown, built, title, thing, kind)
        if file is None:
            contents[ESTIMATOR] = gp.estimator_bytes(listening)
        options.write_together(folder, contents)
    click.echo(f"{plan.mode}  {1e3 * plan.size:g} mm {'feasible' if plan.feasible else 'not feasible'}")
    click.echo(f"fingertip at x {1e3 * plan.target[0]:.1f}, y {1e3 * plan.target[1]:.1f} mm (palmar) of the MCP")
    held = (at_hold(log, kind, plan.joints) for kind in ("angle", "angle_est", "angle_std"))
    columns = zip(plan.tendons, plan.tensions, plan.joints, plan.wanted, plan.planned, plan.shortfall, *held)
    rows = [
        (tendon, f"{tension:.2f} N", joint, *(f"{v:.3f}" for v in angles), f"{guess:.3f} ± {deviation:.3f} rad")
        for tendon, tension, joint, *angles, guess, deviation in columns
    ]
    titles = ("tendon", ">tension", "joint", ">wanted", ">planned", ">short by", ">reached", ">estimated")
    options.print_table(titles, rows)
    if not plan.feasible:
        click.secho(f"not feasible: {plan.reason}", fg="yellow", err=True)
    click.echo(f"wrote {folder}/: {', '.join(contents)}")
    return plan


def parse_size(text: str) -> float:
    """`60mm` or `6 cm` as metres; InputError for no number, no unit or no length."""
    from exodrake.model.units import quantity

    size = quantity(text, "m", "--size")
    if text.strip()[-1].isdigit():
        raise InputError(f"--size is {text!r}, wanted a number with a unit, such as 60mm or 6cm")
    return size
