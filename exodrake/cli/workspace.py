"""`exodrake workspace`: areas within reach of the fingertip."""

from pathlib import Path

import click

from exodrake.cli.options import OutputFolder, refuse_others, robot_option


@click.command()
@robot_option()
@click.option(
    "--out",
    type=OutputFolder(),
    default=Path("workspace"),
    show_default=True,
    help="Folder for the results.",
)
@click.option("--samples", type=int, default=40_000, show_default=True, help="Points of the Monte Carlo areas.")
@click.option("--steps", type=int, default=25, show_default=True, help="Tensions per tendon in the assisted workspace.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
def command(robot: str, out: Path, samples: int, steps: int, seed: int) -> None:
    """Areas that fingertip and distal phalanx reach, by polygon union and Monte Carlo.

    Writes workspace.csv and workspace.png; `make paper` compares them with the paper's Table 2.
    """
    from rich.console import Console
    from rich.markup import escape

    from exodrake.core.files import write_folder
    from exodrake.identification.workspace import HEAD, SPONTANEOUS, areas, areas_csv, assisted, workspace_figure
    from exodrake.machines.robot_file import load_robot
    from exodrake.report.terminal import table

    loaded = load_robot(robot)
    refuse_others("workspace", loaded, "finger.length")
    lengths = tuple(loaded.channels("finger.length").tolist())
    wired = assisted(loaded, steps)
    rows = areas(lengths, SPONTANEOUS, wired, samples, seed)
    contents = {
        "workspace.csv": areas_csv(rows).encode(),
        "workspace.png": workspace_figure(lengths, SPONTANEOUS, wired),
    }
    files = write_folder(out, contents)
    marks = [f">{heading}" if "[" in heading else heading for heading in HEAD]
    Console().print(table([escape(heading).replace(" \\[", "\n\\[") for heading in marks], rows))
    click.echo("wrote " + ", ".join(str(name) for name in files))
