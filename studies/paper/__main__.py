"""`python -m studies.paper`: the paper's figures, tables and claims beside ours, as one page."""

from pathlib import Path

import click
from rich.console import Console

from exodrake.cli.main import OneLineErrors
from exodrake.cli.options import print_table
from exodrake.core.files import make_folder, write_text
from studies.paper import page
from studies.paper.claim import FULL, QUICK, count
from studies.paper.study import DATA, MODEL


@click.command(cls=OneLineErrors)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("paper"), show_default=True, help="Folder for the results."
)
@click.option("--quick", is_flag=True, help="Fewer points: for a first look and for tests; numbers are rougher.")
@click.option("--docs", type=click.Path(path_type=Path), help="Also write the page of the documentation (Markdown).")
@click.option("--seed", type=int, default=0, show_default=True, help="Of noise, markers and the held-out sweeps.")
def command(out: Path, quick: bool, docs: Path | None, seed: int) -> None:
    """Every figure and table of the paper that has data behind it, from simulation, beside the printed numbers.

    Writes paper.html, one page that needs nothing from outside, and claims.csv: printed, ours, verdict, reason.
    """
    make_folder(out)
    with Console(stderr=True).status("simulating the paper: a minute, and one more where kernels must be compiled"):
        found = page.reproduce(QUICK if quick else FULL, seed)
        contents = {out / "paper.html": page.page(found), out / "claims.csv": page.claims_csv(found.claims)}
    if docs:
        contents[docs] = page.docs_page(found)
    for path, text in contents.items():
        write_text(path, text)
    print_table(("", "claim", "verdict"), [(c.where, c.what, c.verdict) for c in found.claims])
    click.echo(", ".join(f"{number} {verdict}" for verdict, number in count(found.claims).items()))
    data, model = found.study.error(DATA), found.study.error(MODEL)
    click.echo(
        f"Fig. 11, simulated, whole sweeps held out: data-driven {data:.3f} rad, constant stiffness {model:.3f} rad,"
        f" {found.study.ratio:.1f} times with friction and creep of assumed size, {found.study.clean_ratio:.1f} without"
    )
    click.echo("wrote " + ", ".join(str(path) for path in contents))


if __name__ == "__main__":
    command()
