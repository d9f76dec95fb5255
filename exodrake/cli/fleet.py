"""`exodrake fleet`: the answers to many cases as a table and an HTML report."""

from __future__ import annotations

from pathlib import Path

import click

from exodrake.cli.options import AnyPath

LISTED, CAUSE = 4, 2  # columns of the report's table that the terminal shows, and the one that is wrapped
FILE = {"type": AnyPath(), "default": None, "metavar": "FILE"}


@click.command()
@click.argument("source", type=AnyPath(), metavar="FOLDER_OR_TABLE")
@click.option("--out", **FILE, help="Write the report: which robots, which causes, since when.")
@click.option("--table", **FILE, help="Write the table, a row each case, as Parquet.")
def command(source: Path, out: Path | None, table: Path | None) -> None:
    """Say of many diagnosed cases which robots have which causes, and since when.

    FOLDER_OR_TABLE is the folder that `exodrake diagnose CASE... --out FOLDER` wrote, or a table made from it by
    --table. Cases belong to the robot that `serial:` names in their case.yaml, and are ordered by `date:`.
    """
    from rich.console import Console
    from rich.markup import escape

    from exodrake.cli.diagnose import check_target
    from exodrake.core.files import write_bytes, write_text
    from exodrake.diagnosis.fleet import read_answers, read_table, table_bytes
    from exodrake.report.fleet import fleet_html, members, robot_table
    from exodrake.report.terminal import table as table_of

    for path in (out, table):
        check_target(path)
    rows = read_answers(source) if source.is_dir() else read_table(source)
    if table is not None:
        write_bytes(table, table_bytes(rows))
    if out is not None:
        write_text(out, fleet_html(rows, source.resolve().name))
    shown = robot_table(members(rows))
    titles, cells = (
        shown.header[:LISTED],
        [[escape(cell.replace("`", "")) for cell in row[:LISTED]] for row in shown.rows],
    )
    Console(highlight=False).print(table_of(titles, cells, wrapped=CAUSE))
    for path in (table, out):
        if path is not None:
            click.echo(f"written {path}")
