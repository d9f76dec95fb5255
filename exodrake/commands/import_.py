"""`exodrake import`: a foreign recording as a log."""

from pathlib import Path

import click


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--map", "map_file", required=True, type=click.Path(path_type=Path), help="Mapping file (YAML), see below."
)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Log to write; its ending is the format.")
def command(recording: Path, map_file: Path, out: Path) -> None:
    """Turn RECORDING (text, MAT, NPY, NPZ, Parquet, ROS 2 bag in MCAP) into a log in our names and SI.

    The mapping file says which foreign column is which, in what unit:

    \b
    time: {column: timestamp, unit: us, start: 0}
    columns:
      load_cell_1: {name: tension_AF, unit: mN, scale: 0.5, offset: -12}
      "positions[0]": {name: position_shoulder, unit: deg}
      "/joint_states:position[MCP]": {name: angle_MCP, unit: rad}    # ROS 2
    period: 0.02       # optional: frames of this length [s]
    separator: ";"     # optional; likewise decimal, skip, heading, hold, stamp
    """
    from exodrake.formats.foreign import import_log
    from exodrake.log import write_log

    log = import_log(recording, map_file)
    write_log(log, out)
    click.echo(f"{out}: {len(log)} rows, {len(log.columns)} columns: {', '.join(log.columns)}")
