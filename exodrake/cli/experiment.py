"""`exodrake experiment`: the motion that tells the explanations still in play apart."""

import click

import exodrake as exo
from exodrake.cli import options
from exodrake.core.progress import stages

ENOUGH = 0.5  # probability below which an experiment is not recommended: assumed
ADVICE = (
    "no motion of the free robot within its limits tells them apart for certain; measure at a known state instead: at "
    "a mechanical stop for the zero of an encoder, under known weights for a force, a clamped joint for a stiffness"
)


@options.command()
@click.argument("case", type=options.AnyPath())
@click.option("--out", type=options.OutputFile("reference.csv"), required=True,
              help="References to be sent to the robot, or a folder for them; the figure lies beside.")  # fmt: skip
@click.option("--case", "folder", default=None, metavar="FOLDER", type=options.AnyPath(),
              help="Folder of the case, for an answer that lies elsewhere.")  # fmt: skip
@click.option("--duration", type=float, default=None, help="Length of the experiment, 20 to 60 s [60].")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the search.")
@options.robot_option()
def command(case, out, folder, duration, seed, robot) -> object:
    """Design the experiment that tells apart the explanations that the logs of CASE do not reject.

    CASE is a folder of logs, whose diagnosis.json is used if it is up to date, or an answer (`diagnose --json`). The
    motion is the one on which they differ most after each is fitted to it, safe on every one of them. Its log, saved as
    experiment.csv in the folder of the case, decides the next diagnosis.
    """
    import numpy as np

    from exodrake.core.parallel import one_blas_thread
    from exodrake.experiment.contest import prepare_contest, read_rivals
    from exodrake.experiment.design import check_length, design, draw_experiment
    from exodrake.model.display import in_words, percent

    nominal, picture = exo.load_robot(robot), out.with_suffix(".png")
    if out.parent.is_dir():
        options.check_target(picture)
    options.refuse_cases(case)
    check_length(nominal, duration)
    with stages() as progress:
        problem, rivals, why_none = read_rivals(case, nominal, folder, progress)
    if why_none:
        click.echo(why_none)
        return {"probability": None, "reason": why_none}
    with options.waiting("searching for the motion that tells them apart"), one_blas_thread():
        contest = prepare_contest(problem, rivals)
        best = design(contest, duration, seed)
    expected, names = best.information, [e.name for e in contest.explanations]
    pairs = [(names[i], names[j], left, expected.power(i, j)) for (i, j), left in sorted(expected.left.items())]
    rows = [(true, rival, f"{left:.3g}", percent(power)) for true, rival, left, power in pairs]
    options.print_table(("if the cause is", "rejected", ">what it leaves (T)", ">probability"), rows, wrapped=0)
    click.echo(f"\n{percent(expected.probability)} expected: all but the true cause are rejected")
    click.echo(f"{percent(best.random)} promised by a random motion as long, the median of those that were tried")
    if expected.probability < ENOUGH:
        click.echo(f"{click.style('note', fg='yellow')}    {ADVICE}")
    click.echo()
    rows = []
    for name, unit, *spans in best.safety.spans(contest.records(best.reference)):
        rows.append((name, *(" to ".join(in_words(x, unit) for x in span) for span in spans)))
    options.print_table(("signal", ">on any explanation", ">allowed"), rows)
    if best.size < 1.0:
        click.echo(f"made smaller, to {percent(best.size)}, so that no signal leaves its range")
    click.echo()
    machine, values = nominal.machine, best.reference.values
    columns = dict(zip(machine.log_names(machine.references), values.T, strict=True))
    log = exo.Log(machine.frame * np.arange(len(values)), columns)
    options.write_files({out: log, picture: draw_experiment(contest, best)})
    click.echo(
        "save its log as experiment.csv in the folder of the case (in its case.yaml: role fit), and diagnose again"
    )
    told = [dict(zip(("cause", "rejected", "left", "probability"), pair)) for pair in pairs]
    return {"probability": expected.probability, "random": best.random, "size": best.size, "pairs": told}
