"""`exodrake diagnose`, of a case or of many side by side; `fleet`, of many answers; `calibrate`, its error rates.

`exodrake check`: what a case is good for. `exodrake experiment`: the motion that tells explanations apart.
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import click
from rich.markup import escape

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError
from exodrake.core.progress import Stage, show_count, stages, where_to_run

FILES = _, REPORT, IMPROVED = "diagnosis.json", "report.html", "improved.yaml"  # of the answer to one case
FLEET, DIAGNOSED = "fleet.html", Path("diagnosed")
TOP, FEW = 3, 4  # effects that `check` lists for each; for fewer sensors
ENOUGH = 0.5  # probability below which an experiment is not recommended: assumed
ADVICE = (
    "no motion of the free robot within its limits tells them apart for certain; measure at a known state instead: at "
    "a mechanical stop for the zero of an encoder, under known weights for a force, a clamped joint for a stiffness"
)
NO_GAP = "A gap of fewer noise standard deviations beyond noise on every channel is none [0.3]."
NO_ANSWER: dict[str, Any] = {"where": {"block": ""}, "effects": [], "equivalents": [], "closure": {"overall": {}}}


@click.command()
@click.argument("cases", nargs=-1, required=True, metavar="CASE...")
@click.option("--out", type=options.OutputFolder(), help="Folder for all files [of several cases: diagnosed].")
@options.json_target
@click.option("--report", type=options.OutputFile(REPORT), help="Write the report alone, as one HTML file.")
@click.option("--out-robot", type=options.OutputFile(IMPROVED), help="Write the improved robot alone.")
@options.robot_option(default="")
@click.option("--effects", "only", default="", metavar="ID,...", help="Try these effects only.")
@click.option("--without", default="", metavar="ID,...", help="Do not try these effects.")
@click.option("--negligible", metavar="NUMBER", type=click.FloatRange(min=0.0), help=NO_GAP)
@click.option("--discover/--no-discover", default=None, help="Look for a law that the library lacks [for UNKNOWN].")
@click.option("--out-law", metavar="FOLDER", type=options.AnyPath(), help="Write that law, as a plugin with its robot.")
@click.option("--profile", is_flag=True, help="Say how much processor time and simulated time each stage took.")
@click.option("--jobs", type=click.IntRange(min=1), help="Processor cores to use [all].")
@click.option("--cluster", metavar="ADDRESS", help="Of several cases: Dask scheduler to run on.")
@click.option("--allow-outside", is_flag=True, help="Read logs that lie outside the folder of their case, too.")
@click.option("--redo", is_flag=True, help="Of several cases: answer anew what another configuration answered.")
def command(
    cases, json_file, report, out_robot, robot, only, without, jobs, out, cluster, redo, allow_outside, profile,
    discover, out_law, negligible,
) -> None:  # fmt: skip
    """Say where the logs of CASE differ from the robot's model, which effect causes it and how far it shrinks.

    CASE is a folder of logs (see its case.yaml) or one log file. --out FOLDER takes diagnosis.json, report.html and
    improved.yaml, the robot for `exodrake simulate --robot`.

    Several cases, or a folder of cases, are diagnosed side by side into FOLDER/CASE, with fleet.html above them. Each
    answer is written as soon as it is there; the same command goes on where it was interrupted. --json gives one list.
    """
    tried = options.choose_effects(robot, only, without)
    if len(cases) > 1 or options.cases_in(Path(cases[0])):
        of_one = {"--report": report, "--out-robot": out_robot, "--out-law": out_law, "--discover": discover}
        if given := [name for name, value in of_one.items() if value]:
            raise click.UsageError(f"{given[0]} is for one case; the answers to several are written to --out")
        with options.quiet(json_file):
            answers = diagnose_many(
                cases, out or DIAGNOSED, robot, jobs or -1, cluster, redo, tried, negligible, allow_outside
            )
        return options.end(answers, json_file)
    if cluster or redo:
        raise click.UsageError("--cluster and --redo are for several cases")
    wanted = zip((json_file, report, out_robot), FILES)
    json, report, improved = (given or (out and out / name) for given, name in wanted)
    if jobs is not None:
        import numba

        from exodrake.core.parallel import thread_limit

        numba.set_num_threads(min(jobs, numba.config.NUMBA_NUM_THREADS))  # pyright: ignore
        thread_limit(count=jobs)
    discover = True if out_law is not None and discover is None else discover
    diagnose_case(cases[0], robot, json, report, improved, out_law, tried, allow_outside, profile, discover, negligible)


def diagnose_case(
    case: str, robot: str, json: Path | None, report: Path | None, improved: Path | None,
    law: Path | None = None, tried: frozenset[str] | None = None, allow_outside: bool = False, profile: bool = False,
    discover: bool | None = None, negligible: float | None = None,
) -> exo.Diagnosis:  # fmt: skip
    """Diagnose one case, print the summary and write the files; `json`, which may be `-`, prints the answer alone.

    The answer is written before a missing law is sought, and before the report: an error in either loses nothing.
    """
    from exodrake.diagnosis.problem import list_required, make_problem
    from exodrake.report import diagnosis_html
    from exodrake.report.terminal import print_profile, print_summary

    nominal = exo.load_robot(robot or options.DEFAULT)
    read = exo.read_case(case, list_required(nominal.machine), nominal.machine.frame, allow_outside)
    known: list[exo.Diagnosis] = []
    written: dict[Path, None] = {}
    spent: dict[Stage, float] = {}

    def keep(found: exo.Diagnosis) -> None:
        """Writes the answer with its command, and the report last."""
        if made := found.provenance:
            found = replace(found, provenance=replace(made, command=options.command_line()))
        known[:] = [found]
        for path, text in (
            (json, lambda: options.json_text(found)),
            (improved, lambda: found.robot_file(found.robot)),
            (report, lambda: diagnosis_html.report_html(found, found.problem or make_problem(read, nominal))),
        ):
            if path and path != options.STDOUT:
                options.write_files({path: text()}, announce=False)
                written[path] = None

    try:
        with stages(spent) as progress:
            from exodrake.diagnosis.pipeline import diagnose
            from exodrake.diagnosis.result import UNKNOWN

            wanted = (lambda verdict: verdict == UNKNOWN) if discover is None else lambda _: discover
            found = diagnose(read, nominal, progress, tried, wanted, keep, negligible)
        keep(found)
        missing = found.missing_law
        if law and missing and missing.robot:
            from exodrake.diagnosis.discovery.law_code import write_law

            written.update(dict.fromkeys(write_law(law, missing.id, missing.text, missing.robot, found.case)))
    finally:  # also of a search for a law, or a report, that is interrupted or fails
        if known and json == options.STDOUT:
            click.echo(options.json_text(known[0]), nl=False)
        elif known:
            print_summary(known[0])
            if profile:
                print_profile(known[0], spent)
            for path in written:
                click.echo(f"wrote {path}")
    return known[0]


def diagnose_many(
    cases: tuple[str, ...], out: Path, robot: str, jobs: int, cluster: str | None, redo: bool,
    tried: frozenset[str] | None, negligible: float | None, allow_outside: bool,
) -> list[dict]:  # fmt: skip
    """Diagnose cases in parallel, and return the answers. Exit status 1 if some fail; InputError before the work."""
    from exodrake.diagnosis.fleet import find_answers, read_answers
    from exodrake.diagnosis.many import FAILURE, diagnose_all, read_stored
    from exodrake.diagnosis.result import CAUSE
    from exodrake.report.diagnosis_html import report_html
    from exodrake.report.fleet import find_reports, fleet_html
    from exodrake.report.wording import closure, share

    places = map_places(cases, out)
    with show_count("diagnosing") as count:
        typed = options.command_line()
        failed = diagnose_all(
            places, jobs, cluster, count, redo, robot, tried, negligible, report_html, typed, allow_outside
        )
    rows, answers = [], []
    for place in places.values():
        none: dict[str, Any] = {"verdict": FAILURE, "reasons": [failed.get(place.name, "")], **NO_ANSWER}
        answer: dict[str, Any] = (read_stored(place) or none) | {"case": place.name}
        causes = []
        answers.append(answer)
        for effect in (e for e in answer["effects"] if e.get("role", CAUSE) == CAUSE):
            names = " or ".join([effect["id"], *(rival["id"] for rival in effect.get("rivals") or ())])
            value = (effect.get("share") or {}).get("value")  # answers of older versions lack it
            causes.append(names if value is None else f"{names} {share(value)}")
        value = answer["closure"]["overall"].get("value") if causes else None
        refuted = " (not confirmed)" if answer.get("confirmed") is False else ""
        texts = answer["verdict"] + refuted, ", ".join(causes), "" if value is None else closure(value)
        rows.append((escape(place.name), *texts))
    options.print_table(("case", "verdict", "causes", ">closure"), rows, wrapped=2)
    links = find_reports(find_answers(out), out / FLEET)
    options.write_files({out / FLEET: fleet_html(read_answers(out), out.resolve().name, links)})
    options.note_failures(failed)
    return answers


def map_places(cases: tuple[str, ...], out: Path) -> dict[Path, Path]:
    """Case -> folder for its answer in `out`, a doubled name with the parent's; InputError if that is doubled, too."""
    from exodrake.data.formats import stem

    paths = [path for name in cases for path in options.cases_in(Path(name)) or [Path(name)]]
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
    names = [path.resolve().name if path.is_dir() else stem(str(path)) for path in paths]
    cases_of: dict[Path, Path] = {}
    for path, name in zip(paths, names):
        place = out / (name if names.count(name) == 1 else f"{path.resolve().parent.name}_{name}")
        if (namesake := cases_of.setdefault(place, path)) is not path:
            raise InputError(f"{path}: has the same name as {namesake}, and so would its answer")
    return {path: place for place, path in cases_of.items()}


@options.command()
@click.argument("sources", nargs=-1, required=True, type=options.AnyPath(), metavar="ANSWERS...")
@click.option("--out", type=options.OutputFile(FLEET), help="Write the report: which robots, which causes, since when.")
@click.option("--table", type=options.OutputFile("fleet.parquet"), help="Write the table, a row each case, as Parquet.")
def summarise_fleet(sources, out, table) -> object:
    """Say of many diagnosed cases which robots have which causes, and since when.

    ANSWERS are folders that `exodrake diagnose CASE... --out FOLDER` wrote, files of `exodrake diagnose --json`,
    folders of these, or the one table that --table made. A case belongs to the robot that `serial:` names in its
    case.yaml, else to one of its own; `date:` orders them.
    """
    from exodrake.diagnosis.fleet import find_answers, read_answers, read_table, table_bytes
    from exodrake.report.fleet import find_reports, fleet_html, members, robot_table

    tabled = len(sources) == 1 and sources[0].suffix.lower() != ".json" and not sources[0].is_dir()
    rows = read_table(sources[0]) if tabled else read_answers(*sources)
    files: dict[Path, str | bytes] = {table: table_bytes(rows)} if table else {}
    if out:
        links = {} if tabled else find_reports(find_answers(*sources), out)
        title = sources[0].resolve().name if len(sources) == 1 else f"{len(sources)} folders or files"
        files[out] = fleet_html(rows, title, links)
    shown = robot_table(members(rows))  # of its columns the first four
    cells = [[escape(cell.replace("`", "")) for cell in row[:4]] for row in shown.rows]
    options.print_table(shown.header[:4], cells, wrapped=shown.header.index("Cause"))
    options.write_files(files)
    return rows


@options.command()
@options.robot_option()
@click.option("--case", "folder", metavar="CASE", help="Folder or log whose motion the robots follow.")
@options.option("--cases", default=60, type=click.IntRange(min=1), help="How many robots at most.")
@options.option("--minutes", default=9.0, type=click.FloatRange(min=0.0), help="Time for them.")
@options.option("--seed", default=0, type=click.IntRange(min=0), help="Seed of all draws.")
@where_to_run
@click.option("--out", required=True, type=options.OutputFile("calibration.yaml"),
              help="File, or the machine's folder, whose verdicts then state the rates.")  # fmt: skip
def count_errors(robot, folder, cases, minutes, seed, jobs, cluster, out) -> object:
    """Count how often the diagnosis of a machine errs, on simulated robots.

    The robots' parameters are drawn within their tolerances; two of three have an effect of the library. Without
    --case they follow the machine's own experiments. The same seed gives the same robots, whatever --jobs is; fewer
    where the time ends before.
    """
    from exodrake.core import confidence, provenance
    from exodrake.diagnosis import calibrate, calibration, problem
    from exodrake.model.display import percent

    machine = exo.load_robot(robot).machine
    case = exo.read_case(folder, problem.list_required(machine), machine.frame) if folder else None
    with show_count("calibrating", "nothing is kept") as count:
        records, failed = calibrate.calibrate(robot, cases, seed, case, jobs, cluster, count, 60.0 * minutes)
    if failed:
        first = min(failed)
        click.echo(f"{len(failed)} robots failed; robot {first}: {failed[first]}", err=True)
    if not records:
        raise InputError("no robot could be diagnosed")
    counted_robots = len(records) + len(failed)
    if counted_robots < cases:
        click.echo(f"{counted_robots} of {cases} robots in {minutes:g} minutes", err=True)
    motion = ["--case", Path(folder).name] if folder else []
    words = ["exodrake", "calibrate", "--robot", Path(robot).name, *motion, "--cases", str(counted_robots)]
    source = f"{shlex.join([*words, '--seed', str(seed)])}, {date.today()}"
    code = provenance.configuration()["code"]
    found = calibration.Calibration(source, code, calibrate.count_rates(records))
    rows = []
    for name, (k, total) in (found.rates or {}).items():
        if total:
            ends = " to ".join(map(percent, confidence.binomial_interval(k, total)))
            rows.append((name, calibration.RATES[name], f"{k} of {total}", percent(k / total), ends))
    options.print_table(("rate", "meaning", ">count", ">share", ">95 % interval"), rows, wrapped=1)
    options.write_files({out: calibration.calibration_text(found)})
    return found


@options.command()
@click.argument("case", type=options.AnyPath())
@options.robot_option()
@click.option("--effects", "only", default="", metavar="ID,...", help="These effects only.")
@click.option("--without", default="", metavar="ID,...", help="Not these effects.")
@click.option("--out", "--figure", "figure", type=options.OutputFile("check.png"), help="Figure, or a folder for it.")
@click.option("--allow-outside", is_flag=True, help="Read logs that lie outside the folder of their case, too.")
def check_case(case: Path, robot: str, only: str, without: str, figure: Path | None, allow_outside: bool) -> object:
    """Say what CASE is good for: clocks, gaps, saturation, excitation, and which effects it could not tell apart.

    CASE is a folder of logs or one log. The effects are judged on its references alone, by simulating each of them at a
    typical size on the nominal robot; the measured values are not fitted.
    """
    from exodrake.core.parallel import one_blas_thread
    from exodrake.diagnosis.checks.compare import list_few
    from exodrake.diagnosis.checks.preflight import CLEAR, HIDDEN, MISTAKEN, SEEN, draw_figure, preflight
    from exodrake.model.display import find_display, percent

    nominal = exo.load_robot(robot)
    options.refuse_cases(case)
    with options.waiting("reading") as say, one_blas_thread():
        found = preflight(case, nominal, options.choose_effects(robot, only, without), allow_outside, say)

    def show(column: str, value: float) -> str:
        display = find_display(column.rsplit("_", 1)[0], nominal.machine)
        return f"{display.factor * value:.3g} {display.unit}"

    tables = {
        ("log", ">rows", ">duration", ">step", ">jitter", ">missing frames"): [
            (escape(c.file), str(c.rows), f"{c.duration:.4g} s", f"{1e3 * c.step:.4g} ms", f"{100.0 * c.jitter:.1f} %",
             str(c.missing)) for c in found.clocks
        ],
        ("channel", ">motion (std)", ">fast noise (std)", ">missing", ">at its ends"): [
            (c.column, show(c.column, c.motion), show(c.column, c.noise), f"{100.0 * c.missing:.1f} %",
             f"{100.0 * c.saturated:.1f} %")
            for c in found.channels
        ],
        ("reference", ">span", ">of its limits", ">95 % below", ">turns", ">at rest"): [
            (e.column, show(e.column, e.span), "" if e.share != e.share else percent(e.share), f"{e.band:.2g} Hz",
             str(e.reversals), percent(e.rest)) for e in found.excitations
        ],
    }  # fmt: skip
    for titles, rows in tables.items():
        options.print_table(titles, rows)
        click.echo()
    for problem in found.problems:
        click.echo(f"{click.style('note', fg='yellow')}    {problem}")
    if not found.problems:
        click.echo(f"{click.style('nothing wrong', fg='green')} with the recordings")
    click.echo()
    result, rows, clear = found.identifiability, [], []
    for effect in dict.fromkeys(d.effect for d in result.directions):
        own = [d for d in result.directions if d.effect == effect]
        seen = [d for d in own if d.seen >= SEEN]
        hidden = ", ".join(d.channel or "everywhere" for d in own if d.seen < SEEN)
        taken = list_few((name for d in seen for name in d.taken_for), TOP)
        size = ""
        if seen:  # the smallest that is seen on every channel that shows the effect; else the one that was tried
            known = all(d.smallest == d.smallest for d in seen)
            size = f"{max((d.smallest for d in seen), key=abs):.2g}" if known else f"at {seen[0].typical:.2g}"
            size = f"{size} {seen[0].unit}".removesuffix(" -")
        if hidden or taken:
            rows.append((f"[bold]{effect}[/bold]", size, hidden, taken))
        else:
            clear.append(f"{effect} ({size})")
    if rows:
        options.print_table(("effect", ">seen from", "not seen at typical size", "could be taken for"), rows, wrapped=3)
    if clear:
        click.echo(f"seen and distinguished, from the size in brackets: {', '.join(clear)}")
    click.echo(
        f"\n{len(result.select(CLEAR))} of {len(result.directions)} effects and channels are seen and distinguished, "
        f"{len(result.select(MISTAKEN))} could be mistaken, {len(result.select(HIDDEN))} are not seen"
    )
    for signal, noise, left in result.sensors[:1]:
        again = " once more, by a second sensor," if any(signal.name == c.kind for c in nominal.machine.columns) else ""
        click.echo(
            f"{signal.name}{again} would help most: measured with a noise of {noise:.2g} {signal.unit}, "
            f"{len(left.select(MISTAKEN))} could be mistaken and {len(left.select(HIDDEN))} not seen"
        )
    if result.fewer:
        rows = []
        for kinds, left in result.fewer.items():
            clear = {d.effect for d in left.select(CLEAR)}
            lost = list_few((d.effect for d in result.select(CLEAR) if d.effect not in clear), FEW)
            numbers = (str(len(left.select(state))) for state in (CLEAR, MISTAKEN, HIDDEN))
            rows.append((", ".join(kinds), *numbers, lost))
        counts = ">distinguished", ">mistaken", ">not seen"
        click.echo()
        options.print_table(("with these columns alone", *counts, "effects no longer distinguished"), rows, wrapped=4)
    if figure:
        options.write_files({figure: draw_figure(found)})
    return found._asdict() | {"case": found.case.name}


@options.command()
@click.argument("case", type=options.AnyPath())
@click.option("--out", type=options.OutputFile("reference.csv"), required=True,
              help="References to be sent to the robot, or a folder for them; the figure lies beside.")  # fmt: skip
@click.option("--case", "folder", metavar="FOLDER", type=options.AnyPath(),
              help="Folder of the case, for an answer that lies elsewhere.")  # fmt: skip
@click.option("--duration", type=float, help="Length of the experiment, 20 to 60 s [60].")
@options.option("--seed", type=click.IntRange(min=0), default=0, help="Seed of the search.")
@options.robot_option()
def design_experiment(case, out, folder, duration, seed, robot) -> object:
    """Design the experiment that tells apart the explanations that the logs of CASE do not reject.

    CASE is a folder of logs, whose diagnosis.json is used if it is up to date, or an answer (`diagnose --json`). The
    motion is the one on which they differ most after each is fitted to it, safe on every one of them. Its log, saved as
    experiment.csv in the folder of the case, decides the next diagnosis.
    """
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
    log = options.reference_log(nominal, best.reference)
    options.write_files({out: log, picture: draw_experiment(contest, best)})
    click.echo("save its log as experiment.csv in the folder of the case, to be fitted, and diagnose again")
    click.echo("(role: fit in its case.yaml; without a case.yaml the last log by name is held out)")
    told = [dict(zip(("cause", "rejected", "left", "probability"), pair)) for pair in pairs]
    return {"probability": expected.probability, "random": best.random, "size": best.size, "pairs": told}
