"""`exodrake diagnose` of several cases: an answer for each in a folder, and a table of the verdicts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from exodrake.core.errors import InputError


def diagnose_many(
    cases: tuple[str, ...], out: Path | None, robot: str, jobs: int, cluster: str | None, redo: bool,
    tried: frozenset[str] | None, allow_outside: bool = False,
) -> None:  # fmt: skip
    """Diagnose cases in parallel. Exit status 1 if some fail; UsageError or InputError before the work starts."""
    from rich.console import Console

    from exodrake.core.progress import counted
    from exodrake.diagnosis.many import diagnose_all, stored

    if out is None:
        raise click.UsageError("several cases need --out FOLDER")
    places = places_of(cases, out)
    with counted("diagnosing") as count:
        failed = diagnose_all(places, jobs, cluster, count, redo, robot, tried, allow_outside)
    Console().print(verdicts({place.name: stored(place) for place in places.values()}))
    for name, reason in failed.items():
        click.echo(f"{name}: {reason}", err=True)
    if failed:
        raise SystemExit(1)


def places_of(cases: tuple[str, ...], out: Path) -> dict[Path, Path]:
    """Map each case to the folder for its answer. InputError for a missing case, and for two of one name."""
    from exodrake.data.formats import stem

    places: dict[Path, Path] = {}
    for name in cases:
        case = Path(name)
        if not case.exists():
            raise InputError(f"{name}: no such folder")
        place = out / (case.resolve().name if case.is_dir() else stem(name))
        namesake = next((other for other, taken in places.items() if taken == place), None)
        if namesake is not None:
            raise InputError(f"{name}: has the same name as {namesake}, and so would its answer")
        places[case] = place
    return places


def verdicts(answers: dict[str, dict[str, Any] | None]) -> Any:
    """Tabulate case, verdict, causes with their share of the gap, and closure."""
    from rich.markup import escape
    from rich.table import Table

    from exodrake.diagnosis.result import CAUSE
    from exodrake.report.wording import closure

    table = Table("case", "verdict", "causes", "closure")
    for name, answer in answers.items():
        name = escape(name)
        if answer is None:
            table.add_row(name, "[red]failed[/red]", "", "")
            continue
        effects = ", ".join(map(cause, (e for e in answer["effects"] if e.get("role", CAUSE) == CAUSE)))
        value = answer["closure"]["overall"].get("value") if effects else None
        said = "" if value is None else closure(value)
        refuted = " (not confirmed)" if answer.get("confirmed") is False else ""
        table.add_row(name, answer["verdict"] + refuted, effects, said)
    return table


def cause(effect: dict[str, Any]) -> str:
    """A cause with its rivals and its share of the gap, which answers of older versions lack."""
    from exodrake.report.wording import share

    names = " or ".join([effect["id"], *(rival["id"] for rival in effect.get("rivals") or ())])
    value = (effect.get("share") or {}).get("value")
    return names if value is None else f"{names} {share(value)}"
