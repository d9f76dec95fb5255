"""`exodrake response`: frequency response from a log, between two columns or of every block, beside the robot's."""

from __future__ import annotations

import click

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError


@click.command()
@options.CASE
@click.option("--from", "input", default="", metavar="COLUMN", help="Input, such as tension_AF; else every block.")
@click.option("--to", "output", default="", metavar="COLUMN", help="Output, such as angle_PIP.")
@options.robot_option("file")
@options.robot_changes
@click.option("--improved", type=options.AnyPath(), metavar="FILE", help="Robot file of an improved robot.")
@click.option("--segment", type=click.FloatRange(0.0, min_open=True), help="Length of Welch's segments [s].")
@click.option("--out", type=options.OutputFolder(), help="Folder for response.png and response.json.")
@options.json_option
def command(cases, input, output, file, parameters, effects, parts, improved, segment, out, json_file) -> None:
    """Estimate frequency responses from logs, with coherence, and set them beside the robot's on the same references.

    CASE_OR_LOG is a case folder, or one or several logs, which are averaged. Logs without the robot's references are
    estimated alone.
    """
    from exodrake.analysis.log_response import TICKS, block_responses, plot_responses
    from exodrake.data.case import gather_logs
    from exodrake.data.plot import render_png

    if bool(input) != bool(output):
        raise InputError("--from and --to belong together; without both, every block is estimated")
    robot = options.change_robot(exo.load_robot(file), parameters, effects, parts)
    case = gather_logs(cases[0] if len(cases) == 1 else cases)
    other = exo.load_robot(improved) if improved else None
    if input:
        wanted = robot.machine.log_names(robot.machine.references)
        follows = all(item.log.has(name) for item in case.logs for name in wanted)
        if not follows:
            click.echo(f"note: no references of {robot.machine.name} in the logs, so no robot beside them", err=True)
        robots = (robot, other) if follows else (None, None)
        found = [exo.frequency_response(case, input, output, *robots, segment)]
    else:
        found = block_responses(case, {"nominal": robot} | ({"improved": other} if other else {}), segment)
    rows, models = [], list(found[0].models) if found else []
    for one in found:
        f = one.frequency[one.band]
        band = f"{f[0]:.3g} to {f[-1]:.3g}" if len(f) else "unresolved"
        gaps = (one.in_words(name) for name in models)
        rows.append((f"{one.input} → {one.output}", band, f"{one.explained:.0%}", *gaps))
    titles = ("response", ">resolved\n\\[Hz]", ">explained", *(f">measured /\n{name}" for name in models))
    options.print_table(titles, rows, aside=json_file == "-")
    if len(found) == 1:
        one, gaps = found[0], [found[0].gap(name) for name in models]
        known, f = one.resolved.nonzero()[0], one.frequency[one.band]
        ticks = [tick for tick in TICKS if len(f) and f[0] <= tick <= f[-1]]
        rows = []
        for k in sorted({int(known[abs(one.frequency[known] - tick).argmin()]) for tick in ticks}):
            cells = (f"{a[k]:+.1f} dB, {b[k]:+.0f} deg" for a, b in gaps)
            rows.append((f"{one.frequency[k]:.3g}", f"{one.coherence[k]:.2f}", *cells))
        options.print_table((">Hz", ">coherence", *titles[3:]), rows, aside=json_file == "-")
    files = {"response.png": render_png(plot_responses(found))} if out else {}
    options.write_answer([one.to_dict() for one in found], "response", json_file, out, files)
