"""`exodrake show`, `compare` and `export`: a log as a moving robot, beside a second one, or in another format.

`export` also writes a robot for another simulator; `import` makes a log or a case of foreign recordings.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import click
from rich.markup import escape

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.machines.robot_file import machine_folders, machine_named

if TYPE_CHECKING:
    from exodrake.data.import_log import Mapped

MAPPING = "mapping.yaml"  # in the folder of a machine


@options.command()
@click.argument("log", type=options.AnyPath())
@options.robot_option()
@click.option("--out", type=options.AnyPath(), help="File to write [LOG with .html].")
@click.option("--estimated", is_flag=True, help="Show the estimated joint angles, not the measured ones.")
@click.option("--open", "show", is_flag=True, help="Open the file in the browser.")
def show_log(log, robot, out, estimated, show) -> None:
    """Write LOG as HTML with the moving robot, its tendons coloured by tension.

    LOG is a log file, or a folder that `exodrake simulate` wrote.
    `#t=1.5` at the end of the address stops it at that time.
    """
    from exodrake.diagrams.meshcat import recording_html

    kind = "angle_est" if estimated else ""
    file = options.log_in(log)
    html = recording_html(exo.read_log(file), exo.load_robot(robot), log.name or log.resolve().name, angles=kind)
    target = out or file.with_name(file.name.split(".")[0] + ".html")
    options.write_files({target: html})
    if show:
        click.launch(str(target))


@options.command()
@click.argument("first", type=options.AnyPath(), metavar="A")
@click.argument("second", type=options.AnyPath(), metavar="B")
@options.robot_option()
@click.option("--out", type=options.OutputFile("compare.png"), help="Figure to write, or a folder for it.")
def compare_logs(first, second, robot, out) -> exo.Comparison:
    """Overlay logs A and B, draw B less A below, and print RMS, mean and largest difference of each common signal.

    A and B are log files, or folders that `exodrake simulate` wrote. Where the clocks differ, B is read between its
    samples. The robot gives labels, units and colours.
    """
    from exodrake.data.plot import remarks
    from exodrake.model.display import find_display
    from exodrake.model.units import find_kind

    machine = exo.load_robot(robot).machine
    one, other = (exo.read_log(options.log_in(path)) for path in (first, second))
    found = exo.compare(one, other)
    names = (first.name, second.name) if first.name != second.name else found.names
    rows = []
    for name, gap in found.signals.items():
        kind = find_kind(name) or name
        display, channel = find_display(kind, machine, gap.unit), name.removeprefix(kind).strip("_")
        cells = (f"{display.factor * x:.3g}" for x in (gap.rms, gap.mean, gap.largest))
        rows.append((f"{kind} {channel}".rstrip(), display.unit, *cells, f"{gap.at:.2f} s"))
    click.echo(f"B less A, {found.start:g} to {found.end:g} s; A is {found.names[0]}, B {found.names[1]}")
    options.print_table(("signal", "unit", ">RMS", ">mean", ">largest", ">at"), rows)
    for note in found.notes:
        click.secho(f"note: {note}", fg="yellow", err=True)
    if out:
        said = remarks(found, one, machine)
        drawn = one.plot(" and ".join(names), other, names, machine=machine, remarks=said, difference=True)
        options.write_files({out: drawn})
    return found


@options.command()
@click.argument("subject", required=False, default="", metavar="[LOG|ROBOT]")
@click.option("--mjcf", "form", flag_value="mjcf", help="Write a robot as MJCF, for MuJoCo.")
@click.option("--urdf", "form", flag_value="urdf", help="Write a robot as URDF.")
@click.option("--isaac", "form", flag_value="isaac", help="Write a robot's actuators for Isaac Lab, as Python.")
@options.robot_option()
@click.option("--out", required=True, type=options.AnyPath(), help="File to write; a log's ending is its format.")
@click.option("--map", "map_file", type=options.AnyPath(), metavar="FILE",
              help="Write a log as text with the names and units of this mapping file.")  # fmt: skip
@click.option("--start", type=float, help="Of a log: leave out rows before this time [s].")
@click.option("--end", type=float, help="Of a log: leave out rows from this time on [s].")
def export_log(subject, form, robot, out, map_file, start, end) -> None:
    """Turn a LOG into .mcap (Foxglove, PlotJuggler), .parquet, .mat, .npz, .csv or .csv.gz, or a ROBOT into MJCF,
    URDF or actuators of Isaac Lab.

    LOG is a log file, or a folder that `exodrake simulate` wrote. Every format holds the same columns in SI, and reads
    back to the same bits.

    ROBOT is a robot file or the name of a machine, as for --robot, and needs --mjcf, --urdf or --isaac. Its effects go
    along; a comment in the file names what the format cannot state.
    """  # noqa: D205 - click shows the first paragraph whole
    from exodrake.data.import_log import read_mapping
    from exodrake.machines.robot_file import robot_files

    if form:
        if map_file or start is not None or end is not None:
            raise InputError("--map, --start and --end are of a log, and --mjcf, --urdf, --isaac of a robot")
        found = exo.load_robot(subject or robot)
        exo.export_robot(found, out, form)
        effects = len(found.effects())
        click.echo(f"{out}: {found.machine.name} with {effects} effect{'s' * (effects != 1)}")
        return
    if not subject or subject in robot_files() or Path(subject).suffix == ".yaml":
        raise InputError("a robot is exported with --mjcf, --urdf or --isaac; else name a log")
    table = exo.read_log(options.log_in(Path(subject)))
    first, last = float(table.time[0]), float(table.time[-1])
    table = table.between(first if start is None else start, float("inf") if end is None else end)
    if not len(table):
        raise InputError(f"{subject}: no rows between --start and --end (the log runs from {first:g} to {last:g} s)")
    data = owner_table(table, read_mapping(map_file), str(map_file)) if map_file else table
    options.write_files({out: data}, announce=False)
    click.echo(f"{out}: {len(table)} rows, {len(table.columns)} columns")


def owner_table(log: exo.Log, mapped: Mapped, source: str) -> bytes:
    """A log as text with its owner's names, units and layout: a mapping read backwards; `wrap` stays continuous."""
    import numpy as np

    from exodrake.model.units import to_si

    columns = [column for column in mapped.columns if column.name in log.columns]
    if not columns:
        raise InputError(f"{source}: names no column of {log.source or 'the log'} ({', '.join(log.columns[:6])} ...)")
    names = [] if mapped.time is None else [mapped.time]
    cells = [log.time / to_si(np.ones(1), mapped.time_unit, source)] * len(names)
    for column in columns:
        if not column.scale * column.sign:
            raise InputError(f"{source}: column {column.of!r} has a scale of 0, which has no inverse")
        values = log[column.name] / to_si(np.ones(1), column.unit, source)
        cells.append((values / column.sign - column.offset) / column.scale)
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, delimiter=mapped.separator, lineterminator="\n")
    if mapped.heading:
        writer.writerow([*names, *(column.of for column in columns)])
    for row in np.column_stack(cells).tolist():
        writer.writerow(["" if cell != cell else f"{cell:.12g}".replace(".", mapped.decimal) for cell in row])
    return stream.getvalue().encode()


@options.command()
@click.argument("recordings", type=options.AnyPath(), nargs=-1, required=True, metavar="RECORDING...")
@click.option("--map", "map_file", type=options.AnyPath(), metavar="FILE", help="Mapping file (YAML), see below.")
@click.option(
    "--machine", metavar="FOLDER", expose_value=False, callback=options.register_machine,
    help="Machine of your own, whose mapping.yaml is used without --map.",
)  # fmt: skip
@click.option("--unit", default="", metavar="UNIT", help="Of the joints of a LeRobot data set: deg or rad.")
@click.option("--episodes", default="", metavar="0,2,...", help="Of a LeRobot data set [all].")
@click.option("--out", type=options.AnyPath(), metavar="FILE",
              help="Log to write; its ending is the format. Another name: the folder of a case.")  # fmt: skip
@click.pass_context
def import_recordings(context, recordings, map_file, unit, episodes, out) -> object:
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
        frame = machine_named(machine or options.DEFAULT).frame
        period = frame_period([item.log for item in items], mapped, frame)
        if machine is not None and not math.isclose(period, frame, rel_tol=1e-6):
            click.echo(f"note: a row every {period:g} s, a frame of {machine} has {frame:g} s: state period: {frame:g}")
        notes = {item.file: logs[item.protocol].notes for item in items}
        noise = {c: median(item.noise[c] for item in logs.values()) for c in first.noise}
        noise = {column: std for column, std in noise.items() if std > 0.0}
        exo.write_case(exo.Case(out.resolve().name, {}, items, period, noise=noise), out, notes)
    size = f"{sum(len(item.log) for item in logs.values())} rows, {len(first.log.columns)} columns"
    several = f"{len(logs)} logs, " if len(logs) > 1 else ""
    click.echo(f"{out}: {several}{size}: {', '.join(first.log.columns)}")
    for note in cases.merge_notes({n: i.notes for n, i in logs.items()}) if several else first.notes:
        click.echo(f"note: {note}")
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
