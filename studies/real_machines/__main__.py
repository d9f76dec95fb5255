"""`python -m studies.real_machines --data DIR --out docs`: writes `real.md` with its figures."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import click

from exodrake.cli.main import OneLineErrors
from exodrake.core.errors import InputError


@click.command(cls=OneLineErrors)
@click.option(
    "--data",
    required=True,
    type=click.Path(path_type=Path),
    help="Folder with emps, tendon_sheath, sage_so101, dvrk_wrist.",
)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder for real.md and real/*.png.")
@click.option("--only", multiple=True, help="Only these sets; the page is not written then.")
def main(data: Path, out: Path, only: tuple[str, ...]) -> None:
    """Diagnose recordings of real machines."""
    import matplotlib
    import yaml

    matplotlib.use("Agg")
    from exodrake.core.errors import markdown_table
    from exodrake.core.files import write_text
    from exodrake.machines.robot_file import write_robot
    from studies.real_machines.exam import exam
    from studies.real_machines.page import page, verdict
    from studies.real_machines.recordings import available
    from studies.real_machines.study import study

    names = [name for name in available(data) if not only or name in only]
    if not names:
        raise InputError(f"{data}: none of the sets is there")
    (out / "real").mkdir(parents=True, exist_ok=True)
    results = [study(name, data, out / "real", lambda step: click.echo(step, err=True)) for name in names]
    for result in results:
        for title, robot in {f"{result.name}_named": result.diagnosis.robots["improved"], **result.robots}.items():
            write_robot(
                robot, out / "real" / f"{title}.yaml", f"fitted to {result.name} by python -m studies.real_machines"
            )
    if only:
        for result in results:
            click.echo(verdict(result.diagnosis))
            for title, rows in result.tables.items():
                click.echo(f"{title}\n{markdown_table(rows[0], rows[1:])}\n")
        return
    marks = exam(data, progress=lambda step: click.echo(step, err=True))
    texts = yaml.safe_load((files("studies.real_machines") / "texts.yaml").read_text())
    write_text(out / "real.md", page(results, marks, texts))
    click.echo(f"written {out / 'real.md'}")


if __name__ == "__main__":
    main()
