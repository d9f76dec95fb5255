"""`python -m benchmarks`: how fast this machine simulates."""

from pathlib import Path

import click

from exodrake.cli.main import OneLineErrors


@click.command(cls=OneLineErrors)
@click.option(
    "--json", "out", default=None, type=click.Path(path_type=Path, dir_okay=False), help="Also write the rows."
)
@click.option(
    "--seconds", default=20.0, show_default=True, type=click.FloatRange(1.0, 600.0), help="Simulated per engine."
)
@click.option("--engines-only", is_flag=True, help="Leave out the figures of other modules.")
def command(out: Path | None, seconds: float, engines_only: bool) -> None:
    """Measure simulated seconds per second of the Diagram, the compiled simulator and fingers of others."""
    import json
    from dataclasses import asdict

    from rich.console import Console
    from rich.table import Table

    from benchmarks.speed import bench
    from exodrake.core.files import write_text

    console = Console(stderr=True)
    with console.status("measuring"):
        rows = bench(seconds, not engines_only, console.log)
    table = Table("figure", "value", "unit", "target")
    for column in table.columns[1:2]:
        column.justify = "right"
    for row in rows:
        mark = "" if not row.target else " [green]met[/]" if row.met else " [red]missed[/]"
        table.add_row(row.name, f"{row.value:.4g}", row.unit, row.target + mark)
    Console().print(table)
    if out:
        write_text(out, json.dumps([{**asdict(row), "met": row.met} for row in rows], indent=1) + "\n")
        click.echo(f"{out}: {len(rows)} rows")


if __name__ == "__main__":
    command()
