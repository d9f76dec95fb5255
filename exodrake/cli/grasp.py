"""`exodrake grasp`: a grasp mode and an object's size to tensions, run in the Diagram with the estimator listening."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError
from exodrake.core.files import check_folder

ESTIMATOR = "estimator.npz"
RECORDINGS = {  # name -> posture that it shows, and the columns that it is in
    "recording.html": ("reached", "angle"),
    "estimated.html": ("estimated", "angle_est"),
    "planned.html": ("planned", "angle_plan"),
}
WIDTH = 0.04  # m, of a caged cylinder across the finger in the recording


@options.command()
@click.argument("mode")
@click.option("--size", required=True, metavar="SIZE", help="Diameter of the object with its unit: 60mm, '6 cm'.")
@click.option("--estimator", "file", type=options.AnyPath(), help="File of `exodrake train`.")
@options.robot_option()
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the noise.")
@click.option("--out", type=options.OutputFolder(), help="Folder for the files [grasps/MODE-SIZE].")
def command(mode: str, size: str, file: Path | None, robot: str, seed: int, out: Path | None) -> Any:
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
    options.refuse_others("grasp", built, "finger.length")
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
        contents: dict[str, Any] = {
            "log.csv": log,
            "plan.json": options.json_text(asdict(plan)),
            "figure.png": grasp_figure(plan, log, built),
        }
        for name, (what, kind) in RECORDINGS.items():
            title = f"{plan.mode.replace('-', ' ').capitalize()}, {1e3 * plan.size:g} mm, {what}"
            contents[name] = meshcat.recording_html(shown, built, title, thing, kind)
        if file is None:
            contents[ESTIMATOR] = gp.estimator_bytes(listening)
        options.write_together(folder, contents)
    click.echo(f"{plan.mode}  {1e3 * plan.size:g} mm {'feasible' if plan.feasible else 'not feasible'}")
    click.echo(f"fingertip at x {1e3 * plan.target[0]:.1f}, y {1e3 * plan.target[1]:.1f} mm (palmar) of the MCP")
    rows = []
    reached, guess, deviation = (at_hold(log, kind, plan.joints) for kind in ("angle", "angle_est", "angle_std"))
    for i, (tendon, joint) in enumerate(zip(plan.tendons, plan.joints)):
        angles = (f"{v:.3f}" for v in (plan.wanted[i], plan.planned[i], plan.shortfall[i], reached[i]))
        estimated = f"{guess[i]:.3f} ± {deviation[i]:.3f} rad"
        rows.append((tendon, f"{plan.tensions[i]:.2f} N", joint, *angles, estimated))
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
