"""Tables of the workspace: areas of this finger, and the paper's Table 2 beside ours, as CSV, Markdown and on the
terminal."""

from typing import NamedTuple

from exodrake.identification.workspace.area import monte_carlo, reach
from exodrake.identification.workspace.assisted import Assisted
from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, Ranges
from exodrake.identification.workspace.printed import Claim

HEAD = ("motion", "workspace", "exact [mm2]", "Monte Carlo [mm2]", "standard error [mm2]", "points")


class Row(NamedTuple):
    """One area: motion, what moves, exact area and Monte Carlo with its standard error [mm2] and points; empty where
    not made."""

    motion: str
    what: str
    exact: str
    drawn: str
    error: str
    points: str


def areas(lengths, ranges: Ranges, wired: Assisted | None, samples: int, seed: int) -> list[Row]:
    """Areas of the full range of motion (K.M.), and of the assisted motion (A.M.) if given: joints as coupled by the
    wires."""
    rows = []
    for what in (FINGERTIP, DISTAL):
        drawn = monte_carlo(lengths, ranges, what, samples, seed)
        parameters = (f"{1e6 * drawn.value:.0f}", f"{1e6 * drawn.error:.0f}", str(samples))
        rows.append(Row("K.M.", what, f"{1e6 * reach(lengths, ranges, what).area:.1f}", *parameters))
    if wired is not None:
        for what in (FINGERTIP, DISTAL):
            rows.append(Row("A.M.", what, f"{1e6 * wired.region(lengths, what).area:.1f}", "", "", ""))
    return rows


def areas_csv(rows: list[Row]) -> str:
    """The areas as CSV."""
    return "\n".join(",".join(row) for row in (HEAD, *rows)) + "\n"


def table_2_markdown(claims: list[Claim]) -> str:
    """The comparison with the paper as Markdown."""
    head = "| number | as printed | ours | verdict | why |\n|---|---|---|---|---|\n"
    body = "".join("| " + " | ".join(claim) + " |\n" for claim in claims)
    return "# Table 2 of the paper beside ours\n\n" + head + body


def print_report(rows: list[Row], claims: list[Claim]) -> None:
    """Both tables on the terminal."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table(title="Workspace")
    for number, column in enumerate(HEAD):
        table.add_column(column, justify="left" if number < 2 else "right")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    paper = Table(title="The paper's Table 2; table_2.md says why", show_lines=True)
    for column in ("number", "as printed", "ours", "verdict"):
        paper.add_column(column)
    for claim in claims:
        paper.add_row(*claim[:4])
    console.print(paper)
