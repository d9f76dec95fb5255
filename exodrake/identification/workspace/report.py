"""Table of areas, as CSV and on the terminal."""

from typing import NamedTuple

from exodrake.identification.workspace.area import monte_carlo, reach
from exodrake.identification.workspace.assisted import Assisted
from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, Ranges

HEAD = ("motion", "workspace", "exact [mm2]", "Monte Carlo [mm2]", "standard error [mm2]", "points")


class Row(NamedTuple):
    """One area: motion, workspace, exact area, Monte Carlo area, its standard error [mm2] and points, as text."""

    motion: str
    what: str
    exact: str
    drawn: str
    error: str
    points: str


def areas(lengths, ranges: Ranges, wired: Assisted | None, samples: int, seed: int) -> list[Row]:
    """Measure the areas of the full range of motion (K.M.) and, if given, of the assisted motion (A.M.).

    Args:
        lengths: (3,) phalanx lengths [m].
        ranges: Ranges of motion.
        wired: Postures of the assisted motion, or None.
        samples: Points of the Monte Carlo areas.
        seed: Of the random numbers.
    """
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
    """Format the areas as CSV."""
    return "\n".join(",".join(row) for row in (HEAD, *rows)) + "\n"


def print_report(rows: list[Row]) -> None:
    """Print the areas on the terminal."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Workspace")
    for number, column in enumerate(HEAD):
        table.add_column(column, justify="left" if number < 2 else "right")
    for row in rows:
        table.add_row(*row)
    Console().print(table)
