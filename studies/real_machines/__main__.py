"""`python -m studies.real_machines --data DIR --out docs`: writes `real.md` with its figures."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import click
import yaml

from exodrake.cli.main import OneLineErrors
from exodrake.core.errors import InputError, markdown_table
from exodrake.core.files import write_text
from exodrake.diagnosis.result import Diagnosis
from exodrake.machines.robot_file import write_robot
from studies.real_machines.exam import Mark, exam, table
from studies.real_machines.study import FOLDERS, Result, study


@click.command(cls=OneLineErrors)
@click.option("--data", required=True, type=click.Path(path_type=Path), help="Folder of recordings, one for each set.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for real.md and real/*.png.")
@click.option("--only", multiple=True, help="Only these sets; the page is not written then.")
def main(data: Path, out: Path, only: tuple[str, ...]) -> None:
    """Diagnose recordings of real machines."""
    names = [name for name, place in FOLDERS.items() if (data / place).is_dir() and (not only or name in only)]
    if not names:
        raise InputError(f"{data}: none of the sets is there")
    (out / "real").mkdir(parents=True, exist_ok=True)
    results = [study(name, data, out / "real", lambda step: click.echo(step, err=True)) for name in names]
    for result in results:
        robots = {f"{result.name}_named": result.diagnosis.robots["improved"], **result.robots}
        for title, robot in robots.items():
            notes = f"fitted to {result.name} by python -m studies.real_machines"
            write_robot(robot, out / "real" / f"{title}.yaml", notes)
    if only:
        for result in results:
            click.echo(verdict(result.diagnosis))
            for title, rows in result.tables.items():
                click.echo(f"{title}\n{markdown_table(rows[0], rows[1:])}\n")
        return
    marks = exam(data, progress=lambda step: click.echo(step, err=True))
    texts = yaml.safe_load((files("studies.real_machines") / "texts.yaml").read_text())
    write_text(out / "real.md", page(results, marks, texts))
    click.echo(f"written {out / 'real.md'}")


def page(results: list[Result], marks: list[Mark], texts: dict[str, dict[str, str]]) -> str:
    """The page in Markdown, a section for each result; texts are those of `texts.yaml`."""
    agree, better = (sum(rows) for rows in ([m.agrees for m in marks], [m.no_worse for m in marks if m.errors]))
    counts = (
        f"{agree} of {len(marks)} answers agree; {better} of {sum(bool(m.errors) for m in marks)} predict no worse."
    )
    parts = [texts["page"]["head"], counts + "\n", table(marks) + "\n", texts["page"]["sets"]]
    for result in results:
        text = texts[result.name]
        parts += [f"## {text['title']}\n\n{text['published'].strip()}\n", verdict(result.diagnosis)]
        parts += [f"{title}:\n\n{markdown_table(rows[0], rows[1:])}\n" for title, rows in result.tables.items()]
        parts += [f"![{result.name}](real/{name})\n" for name in result.figures]
        parts.append(text.get("remark", "").strip() + "\n")
    parts.append(texts["page"]["shortcomings"])
    return "\n".join(parts).rstrip() + "\n"


def verdict(found: Diagnosis) -> str:
    """Verdict, place, effects with parameters, and closure."""
    place = ", ".join(found.where.joints)
    overall = found.closure.overall
    lines = [
        f"**{found.verdict}**, in the *{found.where.block}*" + (f" ({place})" if place else "") + ".",
        f"Closure on held-out logs {overall.value:.4f} ({overall.low:.4f} to {overall.high:.4f}), "
        f"{found.run_time:.0f} s.",
    ]
    lines += [f"Why: {reason}." for reason in found.reasons]
    rows: list[tuple[str, ...]] = [("effect", "parameter", "joint", "value", "90 % interval")]
    for effect in found.effects:
        for name, item in effect.parameters.items():
            channels = effect.channels.get(name, {}) or {"": item}
            for channel, one in channels.items():
                value = f"{one.value:.4g}" + ("" if one.unit == "-" else f" {one.unit}")
                rows.append((effect.id, name, channel, value, f"{one.low:.4g} to {one.high:.4g}"))
    return "\n".join([*lines, "", markdown_table(rows[0], rows[1:]) if len(rows) > 1 else "", ""])


if __name__ == "__main__":
    main()
