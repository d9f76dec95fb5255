"""Table of areas, as rows and as CSV."""

from exodrake.identification.workspace.area import monte_carlo, reach
from exodrake.identification.workspace.assisted import Assisted
from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, Ranges

HEAD = ("motion", "workspace", "exact [mm2]", "Monte Carlo [mm2]", "standard error [mm2]", "points")


def areas(lengths, ranges: Ranges, wired: Assisted | None, samples: int, seed: int) -> list[tuple[str, ...]]:
    """Measure the areas of the full range of motion (K.M.) and, if given, of the assisted motion (A.M.).

    Args:
        lengths: (3,) phalanx lengths [m].
        ranges: Ranges of motion.
        wired: Postures of the assisted motion, or None.
        samples: Points of the Monte Carlo areas.
        seed: Of the random numbers.

    Returns:
        Rows under HEAD, as text.
    """
    rows = []
    for what in (FINGERTIP, DISTAL):
        drawn, exact = monte_carlo(lengths, ranges, what, samples, seed), reach(lengths, ranges, what).area
        values = (f"{1e6 * exact:.1f}", f"{1e6 * drawn.value:.0f}", f"{1e6 * drawn.error:.0f}", str(samples))
        rows.append(("K.M.", what, *values))
    if wired is not None:
        wired_areas = {what: 1e6 * wired.region(lengths, what).area for what in (FINGERTIP, DISTAL)}
        rows += [("A.M.", what, f"{area:.1f}", "", "", "") for what, area in wired_areas.items()]
    return rows


def areas_csv(rows: list[tuple[str, ...]]) -> str:
    """Format the areas as CSV."""
    return "\n".join(",".join(row) for row in (HEAD, *rows)) + "\n"
