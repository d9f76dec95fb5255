"""`exodrake train` and `estimate`: the joint-angle estimator, validated under both splits, and the angles of a log."""

from dataclasses import replace

import click

import exodrake as exo
from exodrake.cli import options


@options.command()
@click.argument("logs", nargs=-1, required=True, type=options.AnyPath())
@click.option("--out", required=True, type=options.OutputFile("estimator.npz"), help="Estimator file, or a folder.")
@click.option("--points", default=500, show_default=True, type=click.IntRange(50, 4000),
              help="Training points, equispaced.")  # fmt: skip
@click.option("--robot", default="", metavar="FILE", help="Robot file or machine whose signature to record.")
@click.option("--one-sweep-per-log", is_flag=True, help="Do not cut logs at the ramps of their tension references.")
@click.option("--seed", default=0, show_default=True, help="Of the validation's folds.")
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


BAND = "black: estimate, with a band of two standard deviations; in colour: measured"


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
        options.write_files({out: found.log}, announce=False)
        click.echo(f"{out}: {len(found.log)} rows with angle_est and angle_std")
        figure = out.with_name(out.name.split(".")[0] + ".png")
        options.write_files({figure: found.log.plot(f"{log.name}, estimated", details=[BAND])}, announce=False)
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
