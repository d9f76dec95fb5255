"""`exodrake import`: foreign recordings as a log or a case, or what they hold."""

from pathlib import Path
from typing import Any

import click
from rich.markup import escape

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.machines.library import machine_folders, machine_named

FILE = {"type": options.AnyPath(), "default": None, "metavar": "FILE"}
MAPPING = "mapping.yaml"  # in the folder of a machine


@options.command()
@click.argument("recordings", type=options.AnyPath(), nargs=-1, required=True, metavar="RECORDING...")
@click.option("--map", "map_file", **FILE, help="Mapping file (YAML), see below.")
@click.option(
    "--machine", metavar="FOLDER", expose_value=False, callback=options.register_machine,
    help="Machine of your own, whose mapping.yaml is used without --map.",
)  # fmt: skip
@click.option("--unit", default="", metavar="UNIT", help="Of the joints of a LeRobot data set: deg or rad.")
@click.option("--episodes", default="", metavar="0,2,...", help="Of a LeRobot data set [all].")
@click.option("--out", **FILE, help="Log to write; its ending is the format. Another name: the folder of a case.")
@click.pass_context
def command(context, recordings, map_file, unit, episodes, out) -> object:
    """Turn RECORDINGs into a log, or a case of several logs, in our names and SI; without --out list what they hold.

    Text, MAT (structs, version 7.3 too), HDF5, JSON, NPY, NPZ, Parquet, ROS 2 bags (MCAP, SQLite), MCAP with JSON
    messages and LeRobot data sets. A mapping file says which foreign column is which, in what unit; joint states of a
    bag, and actions and states of a LeRobot data set, need none.

    \b
    time: {column: timestamp, unit: us, start: 0}
    columns:
      load_cell_1: {name: tension_AF, unit: mN, scale: 0.5, offset: -12, filter: 10}
      "run.q[0]": {name: position_shoulder, unit: deg, sign: -1, wrap: 360}   # struct, matrix
      "/joint_states:position[MCP]": {name: angle_MCP, unit: rad}             # ROS 2
    derived:
      angle_speed_MCP: {of: angle_MCP, take: rate, filter: 8}
    period: 0.02       # optional: frames of this length [s]
    """  # noqa: D301 - click reads the character \b
    from exodrake.data import case as cases, formats
    from exodrake.data.import_log import Imported, frame_period, import_all, read_mapping

    if out is None:
        return {recording: list_contents(recording) for recording in recordings}
    machine = context.meta.get(options.MACHINE)
    if map_file is None and machine is not None and (own := machine_folders()[machine] / MAPPING).is_file():
        map_file = own
    mapped = None if map_file is None else read_mapping(map_file)
    try:
        chosen = frozenset(int(word) for word in episodes.split(",") if word.strip())
    except ValueError:
        raise InputError(f"--episodes: {episodes!r}, wanted numbers, like 0,2") from None
    logs: dict[str, Imported] = {}
    for recording in recordings:
        for name, item in import_all(recording, mapped, unit, chosen).items():
            if name in logs:
                raise InputError(f"{recording}: there is a log {name!r} already")
            logs[name] = item
    first = next(iter(logs.values()))
    if formats.ending(out) or out.suffix:
        formats.find_format(out)
        if len(logs) > 1:
            raise InputError(f"{out}: {len(logs)} logs, wanted the folder of a case, or --episodes with one number")
        notes = {out.with_name(cases.notes_name(out)): "\n".join((*first.notes, ""))} if first.notes else {}
        options.write_files({out: first.log, **notes}, announce=False)
    else:
        roles = dict.fromkeys(logs, "fit") | ({list(logs)[-1]: "holdout"} if len(logs) > 1 else {})
        items = tuple(exo.CaseLog(logs[n].log, n, role, None, f"{n}.csv.gz") for n, role in roles.items())
        period = frame_period([item.log for item in items], mapped, machine_named(machine or options.DEFAULT).frame)
        notes = {item.file: logs[item.protocol].notes for item in items}
        exo.write_case(exo.Case(out.resolve().name, {}, items, period), out, notes)
    size = f"{sum(len(item.log) for item in logs.values())} rows, {len(first.log.columns)} columns"
    several = f"{len(logs)} logs, " if len(logs) > 1 else ""
    click.echo(f"{out}: {several}{size}: {', '.join(first.log.columns)}")
    for name, item in logs.items():
        for note in item.notes:
            click.echo(f"note: {name}: {note}" if several else f"note: {note}")
    made = {n: {"rows": len(i.log), "columns": i.log.columns, "notes": i.notes} for n, i in logs.items()}
    return {"out": out, "logs": made}


def list_contents(recording: Path) -> dict[str, Any]:
    """Prints the columns of a recording, or the topics of a bag, as a mapping file names them, and returns them."""
    from exodrake.data import ros2, tables
    from exodrake.data.import_log import refuse_folder

    rows, found = [], {}
    if ros2.is_bag(recording):
        unknown = "cannot be decoded: neither JSON nor a ROS 2 message with its definition"
        for topic, (kind, count, fields) in ros2.read_topics(recording).items():
            found[topic] = {"type": kind, "messages": count, "fields": fields}
            rows.append((escape(topic), kind, str(count), unknown if fields is None else escape(", ".join(fields))))
        options.print_table(("topic", "type", ">messages", "fields: column is TOPIC:FIELD"), rows, wrapped=3)
        return found
    if tables.is_dataset(recording):
        name, columns = next(tables.episodes(recording))
        click.echo(f"LeRobot data set, {name}")
    else:
        refuse_folder(recording)
        columns = tables.list_columns(read_bytes(recording), str(recording))
    for name, values in columns.items():
        known = values[values == values]
        counts, ends = (len(values), len(values) - len(known)), (known.min(), known.max()) if len(known) else ()
        found[name] = dict(zip(("samples", "missing", "lowest", "highest"), (*counts, *ends)))
        rows.append((escape(name), *map(str, counts), *([f"{end:.6g}" for end in ends] or ["", ""])))
    options.print_table(("column", ">samples", ">missing", ">lowest", ">highest"), rows)
    return found
