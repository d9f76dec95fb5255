"""`exodrake export`: a log in another file format."""

from pathlib import Path

import click

from exodrake.cli.options import AnyPath, log_in


@click.command()
@click.argument("log", type=AnyPath())
@click.option("--out", required=True, type=AnyPath(), help="File to write; its ending is the format.")
@click.option("--start", type=float, default=None, help="Leave out rows before this time [s].")
@click.option("--end", type=float, default=None, help="Leave out rows from this time on [s].")
def command(log: Path, out: Path, start: float | None, end: float | None) -> None:
    """Turn LOG into .mcap (Foxglove, PlotJuggler), .parquet, .mat, .npz, .csv or .csv.gz.

    LOG is a log file, or a folder that `exodrake simulate` wrote.
    Every format holds the same columns in SI, and reads back to the same bits.
    """
    from exodrake.core.errors import InputError
    from exodrake.data.log_file import read_log, write_log

    table = read_log(log_in(log))
    first, last = float(table.time[0]), float(table.time[-1])
    if start is not None or end is not None:
        table = table.between(first if start is None else start, float("inf") if end is None else end)
    if not len(table):
        raise InputError(f"{log}: no rows between --start and --end (the log runs from {first:g} to {last:g} s)")
    write_log(table, out)
    click.echo(f"{out}: {len(table)} rows, {len(table.columns)} columns")
