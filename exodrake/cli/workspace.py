"""`exodrake workspace`: what the finger can reach, and the paper's Table 2 beside ours."""

from pathlib import Path

import click

from exodrake.cli.options import robot_option


@click.command()
@robot_option()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("workspace"),
    show_default=True,
    help="Folder for the results.",
)
@click.option("--samples", type=int, default=40_000, show_default=True, help="Points of the Monte Carlo areas.")
@click.option("--steps", type=int, default=25, show_default=True, help="Tensions per tendon in the assisted workspace.")
@click.option("--seed", type=int, default=0, show_default=True)
def command(robot: str, out: Path, samples: int, steps: int, seed: int) -> None:
    """Fingertip and distal-phalanx workspaces, exactly and by Monte Carlo, and what of the paper's Table 2 follows.

    Writes workspace.csv, table_2.md and workspace.png.
    """
    from exodrake.identification.kinematics.report import write_all
    from exodrake.identification.workspace import assisted, table_2
    from exodrake.identification.workspace.figure import workspace_figure
    from exodrake.identification.workspace.printed import SPONTANEOUS
    from exodrake.identification.workspace.report import areas, areas_csv, print_report, table_2_markdown
    from exodrake.machines.robot_file import load_robot

    loaded = load_robot(robot)
    lengths = tuple(loaded.channels("finger.length").tolist())
    wired = assisted(loaded, steps)
    rows, claims = areas(lengths, SPONTANEOUS, wired, samples, seed), table_2(wired)
    contents = {
        "workspace.csv": areas_csv(rows).encode(),
        "table_2.md": table_2_markdown(claims).encode(),
        "workspace.png": workspace_figure(lengths, SPONTANEOUS, wired),
    }
    files = write_all(out, contents)
    print_report(rows, claims)
    click.echo("wrote " + ", ".join(str(name) for name in files))
