"""Fig. 13 and Table 2: the workspaces."""

import numpy as np

from exodrake.report.blocks import Drawing, Heading, Table
from studies.paper.claim import Chapter

SIMPLER = 2e-5  # m, outlines are drawn this exactly


def chapter(robot, tensions: int) -> Chapter:
    """Workspaces of fingertip and distal phalanx, whole and assisted. tensions: per wire."""
    from exodrake.identification.workspace import solve_assisted
    from studies.paper.table_2 import table_2

    wired = solve_assisted(robot, tensions)
    caption = (
        "Computed from the lengths of Table 1 and the ranges S.M. of Table 2, pin joints; MCP at the origin, palmar"
        " down. Assisted: statics of the nominal robot, whose stiffness and largest tensions are assumed; red leaves"
        " the grey where the extensor straightens PIP and DIP beyond the spontaneous range."
    )
    lead = (
        "The printed areas K.M. and S.M. do not follow from the printed lengths and ranges: K.M. is twice what the"
        " fingertip can reach. Lengths, the point that was tracked, or the meaning of workspace must differ from the"
        " text. The printed A.M. ranges cannot be radians."
    )
    table = Table(HEAD, table_rows(wired), wide=False)
    body = (Drawing(figure(wired), caption), Heading("Table 2, printed beside ours"), table)
    return Chapter("workspace", "Workspace: Fig. 13, Table 2", lead, body, table_2(wired))


HEAD = (
    "motion", "MCP printed [rad]", "PIP printed", "DIP printed", "area printed [mm²]", "ours: fingertip",
    "ours: distal phalanx",
)  # fmt: skip


def table_rows(wired) -> list[tuple[str, ...]]:
    """Rows under HEAD: ranges and areas as printed, and the areas that the ranges, or the wires, give."""
    from exodrake.identification.workspace import DISTAL, FINGERTIP, LENGTHS, SPONTANEOUS, reach
    from studies.paper.table_2 import AREAS, ASSISTED

    kinds = (FINGERTIP, DISTAL)
    whole = [f"{1e6 * reach(LENGTHS, SPONTANEOUS, what).area:.0f}" for what in kinds]
    part = [f"{1e6 * wired.region(LENGTHS, what).area:.0f}" for what in kinds]
    ranges = [[f"{low:.2f} … {high:.2f}".replace("-", "−") for low, high in spans] for spans in (SPONTANEOUS, ASSISTED)]
    return [
        ("K.M., kinematically possible", "–", "–", "–", f"{AREAS['K.M.']:.2f}", *whole),
        ("S.M., spontaneous", *ranges[0], f"{AREAS['S.M.']:.2f}", *(f"at most {area}" for area in whole)),
        ("A.M., assisted", *ranges[1], f"{AREAS['A.M.']:.2f}", *part),
    ]


def figure(wired) -> str:
    """Both workspaces as SVG."""
    from exodrake.data.plot import new_figure
    from exodrake.identification.workspace import DISTAL, FINGERTIP, LENGTHS, SPONTANEOUS, reach
    from exodrake.report.blocks import RULE, house_style, render_svg

    with house_style():
        drawn = new_figure(9.6, 4.6)
        panels = drawn.subplots(1, 2, sharex=True, sharey=True)
        for axes, what in zip(panels, (FINGERTIP, DISTAL)):
            whole, part = reach(LENGTHS, SPONTANEOUS, what), wired.region(LENGTHS, what)
            fill(axes, whole, "#98a2b3", f"all of the ranges, {1e6 * whole.area:.0f} mm²")
            fill(axes, part, "#c8372d", f"assisted, {1e6 * part.area:.0f} mm²")
            finger(axes, LENGTHS, SPONTANEOUS)
            axes.set_title(what)
            axes.set_aspect("equal")
            axes.set_xlabel("x, along the proximal phalanx [mm]")
            axes.grid(color=RULE, lw=0.5)
            axes.legend(loc="upper left")
        panels[0].set_ylabel("y, palmar [mm]")
        panels[0].set_ylim(92.0, -50.0)
        return render_svg(drawn, "workspace", "workspace of the fingertip and of the distal phalanx")


def fill(axes, region, colour: str, label: str) -> None:
    """A region [m] in mm."""
    region = region.simplify(SIMPLER)
    for number, part in enumerate(getattr(region, "geoms", [region])):
        x, y = 1e3 * np.array(part.exterior.coords).T
        axes.fill(x, y, fc=colour, ec=colour, alpha=0.35, lw=1.0, label=label if number == 0 else None)


def finger(axes, lengths, ranges) -> None:
    """The finger at the middle of its ranges, to scale."""
    from exodrake.identification.workspace import tip

    q = [float(np.mean(span)) for span in ranges]
    cut = ((0.0, 0.0, 0.0), (lengths[0], 0.0, 0.0), (lengths[0], lengths[1], 0.0), lengths)
    x, y = 1e3 * np.array([tip(bones, *q) for bones in cut]).T
    axes.plot(x, y, "-o", color="#1f4f7a", lw=2.4, ms=4.5, mfc="white", label="finger, mid range")
