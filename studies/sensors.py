"""What can be named with fewer sensors: `docs/sensors.md`.

    exodrake blind make --seed 7 --cases 60 --out cases
    python -m studies.sensors cases --labels cases-labels.json --keep kept --out docs/sensors.md

Computed for every effect on the motions of one case, by the linearisation of `exodrake check`; measured on cases with
one effect, diagnosed with columns withheld. What is measured is kept case by case, so the command can be repeated.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from exodrake.cli.main import OneLineErrors
from exodrake.core.errors import markdown_table
from exodrake.core.files import write_text
from exodrake.core.parallel import one_blas_thread
from exodrake.data.case import Case, read_case
from exodrake.diagnosis.checks.preflight import CLEAR, HIDDEN, MISTAKEN, identifiability
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import list_required, make_problem
from exodrake.diagnosis.verdict import decide
from exodrake.machines.robot_file import load_robot
from studies.page_text import keep as keep_result, made

SETS = {
    "all": (),
    "without motion capture": ("angle",),
    "without load cells": ("tension",),
    "encoders alone": ("tension", "angle"),
}  # sensors -> kinds of columns withheld; commands are no sensors and stay


def without(case: Case, hidden: tuple[str, ...]) -> Case:
    """The case without some kinds of columns."""
    logs = []
    for item in case.logs:
        left = [name for name in item.log.signals if name.rsplit("_", 1)[0] not in hidden]
        logs.append(replace(item, log=item.log.only(left)))
    return replace(case, logs=tuple(logs))


def computed(case: Case) -> dict[str, dict[str, str]]:
    """Effect -> sensors -> what the logs of a case would do of it, on the channel where they do best."""
    with one_blas_thread():
        whole = identifiability(make_problem(case, load_robot()))
    found: dict[str, dict[str, str]] = {}
    for sensors, hidden in SETS.items():
        left = next(left for kinds, left in whole.fewer.items() if not {*kinds} & {*hidden}) if hidden else whole
        clear, mistaken = ({d.effect for d in left.select(state)} for state in (CLEAR, MISTAKEN))
        for effect in dict.fromkeys(d.effect for d in left.directions):
            state = CLEAR if effect in clear else MISTAKEN if effect in mistaken else HIDDEN
            found.setdefault(effect, {})[sensors] = state
    return found


def measured(case: Case, hidden: tuple[str, ...]) -> dict[str, Any]:
    """Verdict of a case without some columns, and its causes with their rivals."""
    with one_blas_thread():
        found = isolate(make_problem(without(case, hidden), load_robot()))
        decision = decide(found)
    detected = [d.effect.id for d in found.problem.detected if d.certain]
    causes = [part.effect for part in decision.causes]
    rivals = [rival for part in decision.causes for rival in part.rivals]
    return {"verdict": decision.verdict, "causes": [*causes, *detected], "rivals": rivals}


def outcome(row: dict[str, Any], truth: str) -> str:
    """Result of a case with one effect, in words."""
    verdict, causes = row["verdict"], row["causes"]
    if verdict == "NAMED":
        return "named" if causes == [truth] else "another named"
    if verdict == "AMBIGUOUS":
        return "in the class" if truth in (*causes, *row["rivals"]) else "not in the class"
    return {"UNKNOWN": "unknown", "PARTLY": "partly"}.get(verdict, "not seen")


OUTCOMES = ("named", "in the class", "partly", "unknown", "not seen", "another named", "not in the class")


def page(effects: dict[str, dict[str, str]], rows: dict[str, dict[str, Any]], command: str) -> str:
    """The page."""
    states = (CLEAR, MISTAKEN, HIDDEN)
    counts = [(s, *(sum(own[sensors] == s for own in effects.values()) for sensors in SETS)) for s in states]
    differ = [(f"`{e}`", *(own[sensors] for sensors in SETS)) for e, own in effects.items() if len({*own.values()}) > 1]
    parts = ["# Fewer sensors", TEXT.format(command=command, made=made()), "## Computed"]
    parts += [markdown_table((f"of {len(effects)} effects", *SETS), counts), RELATIVE]
    parts += ["Effects for which the sensors make a difference:", markdown_table(("effect", *SETS), differ)]
    if rows:
        found = {name: [outcome(row[sensors], row["truth"]) for sensors in SETS] for name, row in rows.items()}
        columns = zip(SETS, zip(*found.values()))
        totals = [(sensors, *(own.count(word) for word in OUTCOMES)) for sensors, own in columns]
        cases = [(name, f"`{row['truth']}`", *found[name]) for name, row in rows.items()]
        parts += ["## Measured", MEASURED.format(count=len(rows)), markdown_table(("sensors", *OUTCOMES), totals)]
        parts += [markdown_table(("case", "effect", *SETS), cases)]
    return "\n\n".join(parts) + "\n"


TEXT = """What the diagnosis of the Exo-Index can still name without motion capture (joint angles), without load cells
(tensions) and with the encoders alone (strokes). Commands are no sensors and stay. `exodrake check CASE` says the same
of the motions of a case before it is diagnosed, for any machine.

    {command}

Measured on {made}."""
RELATIVE = """An effect could be mistaken where another one leaves less than a share of what it does to all columns
together, the error of its law. So one that changes the angles most may count as distinguished without them."""
MEASURED = """{count} cases of the reference simulator with one effect each, diagnosed with columns withheld. The robots
are the same in each row; their controllers measure tension in all of them."""


@click.command(cls=OneLineErrors)
@click.argument("folder", type=click.Path(exists=True, path_type=Path))
@click.option("--labels", required=True, type=click.Path(exists=True, path_type=Path), help="Of the set.")
@click.option("--cases", default=15, show_default=True, type=click.IntRange(min=0), help="Cases that are diagnosed.")
@click.option("--keep", required=True, type=click.Path(path_type=Path), help="Folder of what is measured, by case.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Write the page.")
def command(folder: Path, labels: Path, cases: int, keep: Path, out: Path | None) -> None:
    """Compute and measure what can be named with fewer sensors, on cases of the set in FOLDER."""
    keep.mkdir(parents=True, exist_ok=True)
    machine, truths = load_robot().machine, json.loads(labels.read_text())
    truths = truths.get("cases", truths)
    single = [name for name, label in truths.items() if label["kind"] == "single"][:cases]

    def kept(name: str, measure: Any) -> Any:
        return keep_result(keep / f"{folder.name}-{name}.json", measure)

    def read(name: str) -> Case:
        return read_case(folder / name, list_required(machine), machine.frame)

    effects, rows = kept("computed", lambda: computed(read(next(iter(truths))))), {}
    for name in single:
        rows[name] = {"truth": truths[name]["effects"][0]["id"]}
        for sensors, hidden in SETS.items():
            key = f"{name}-{sensors.replace(' ', '-')}"
            rows[name][sensors] = kept(key, lambda name=name, hidden=hidden: measured(read(name), hidden))
        click.echo(f"{name}: {rows[name]}")
    if out:
        words = f"python -m studies.sensors {folder.name} --labels LABELS --cases {cases} --keep kept --out {out}"
        write_text(out, page(effects, rows, words))


if __name__ == "__main__":
    command()
