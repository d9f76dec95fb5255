"""`exodrake import`: a foreign recording as a log, or a known set of recordings as a case."""

from pathlib import Path

import click

from exodrake.core.errors import InputError
from exodrake.machines.library import recorded_machines


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--map", "map_file", default=None, type=click.Path(path_type=Path), help="Mapping file (YAML), see below."
)
@click.option(
    "--from",
    "known",
    default=None,
    type=click.Choice(recorded_machines()),
    help="A known set, which needs no mapping file.",
)
@click.option(
    "--out", required=True, type=click.Path(path_type=Path),
    help="Log to write; its ending is the format. With --from: the case's folder.",
)  # fmt: skip
def command(recording: Path, map_file: Path | None, known: str | None, out: Path) -> None:
    r"""Turn RECORDING (text, MAT, NPY, NPZ, Parquet, ROS 2 bag in MCAP) into a log in our names and SI.

    With --from, RECORDING is the file or folder of a known set, and a case for `exodrake diagnose --robot` comes out.
    Otherwise the mapping file says which foreign column is which, in what unit:

    \b
    time: {column: timestamp, unit: us, start: 0}
    columns:
      load_cell_1: {name: tension_AF, unit: mN, scale: 0.5, offset: -12}
      "positions[0]": {name: position_shoulder, unit: deg}
      "/joint_states:position[MCP]": {name: angle_MCP, unit: rad}    # ROS 2
    period: 0.02       # optional: frames of this length [s]
    separator: ";"     # optional; likewise decimal, skip, heading, hold, stamp
    """
    if (map_file is None) == (known is None):
        raise InputError("import wants either --map FILE or --from SET")
    if map_file is not None:
        from exodrake.data.foreign.import_log import import_log
        from exodrake.data.log_file import write_log

        log = import_log(recording, map_file)
        write_log(log, out)
        click.echo(f"{out}: {len(log)} rows, {len(log.columns)} columns: {', '.join(log.columns)}")
        return
    from exodrake.data.case_folder import write_case
    from exodrake.machines.recordings import reader

    case = reader(str(known))(recording)
    write_case(case, out)
    click.echo(f"{out}: {len(case.logs)} logs; exodrake diagnose {out} --robot {known}")
