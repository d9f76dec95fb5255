"""`python -m studies.gate`: fit cases and answer each by three rules, and the table of their answers.

python -m studies.gate fit --out FITS CASE...            # --robot for a machine other than the Exo-Index
python -m studies.gate table FITS --labels labels.json   # labels of simulated cases
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

import exodrake as exo
from exodrake.core.threads import one_blas_thread
from exodrake.data.case import read_case
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem, required_of
from exodrake.diagnosis.recorded import with_recorded_ranges
from studies.gate.rules import RULES, Answer, score


@click.group()
def main() -> None:
    """Decision rules on the same fits."""


@main.command()
@click.argument("cases", nargs=-1, type=click.Path(path_type=Path, exists=True))
@click.option("--robot", default="exo_index", help="Name of the machine or robot file.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the answers.")
def fit(cases: tuple[Path, ...], robot: str, out: Path) -> None:
    """Answer each case by all rules, from one set of fits; cases that are there already are left alone."""
    out.mkdir(parents=True, exist_ok=True)
    nominal = exo.load_robot(robot)
    for folder in (c for c in cases if not (out / f"{c.name}.json").exists()):
        case = read_case(folder, required_of(nominal.machine), nominal.machine.frame)
        with one_blas_thread():
            found = isolate(make_problem(case, with_recorded_ranges(nominal, case)))
            answers = {name: asdict(rule(found)) for name, rule in RULES.items()}
        (out / f"{folder.name}.json").write_text(json.dumps(answers, indent=1))
        click.echo(f"{folder.name}: " + "; ".join(f"{n}: {a['verdict']} {a['causes']}" for n, a in answers.items()))


@main.command()
@click.argument("fits", type=click.Path(path_type=Path, exists=True))
@click.option("--labels", type=click.Path(path_type=Path, exists=True), required=True, help="Labels of the cases.")
def table(fits: Path, labels: Path) -> None:
    """Print how often each rule is right, by kind of case."""
    truth = json.loads(labels.read_text())["cases"]
    answers = {file.stem: json.loads(file.read_text()) for file in sorted(fits.glob("*.json"))}
    for rule in RULES:
        counts: dict[str, list[int]] = {}
        for name, answer in answers.items():
            effects = [effect["id"] for effect in truth[name]["effects"]]
            for row, right in score(Answer(**answer[rule]), effects).items():
                counts.setdefault(row, []).append(right)
        click.echo(f"{rule}: " + ", ".join(f"{row} {sum(c)}/{len(c)}" for row, c in sorted(counts.items())))


if __name__ == "__main__":
    main()
