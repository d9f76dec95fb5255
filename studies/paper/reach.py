"""Fig. 13 and Table 2: the workspaces, and what follows from other printed values (`physics.md` section 2)."""

import numpy as np

from exodrake.identification.workspace import (
    DISTAL,
    FINGERTIP,
    LENGTHS,
    SPONTANEOUS,
    Ranges,
    reach,
    solve_assisted,
    workspace_figure,
)
from exodrake.report.blocks import RULE, Drawing, Table, house_style, render_svg
from studies.paper.claim import AGREES, DOES_NOT, UNKNOWN, Chapter, Claim

ASSISTED = ((21.27, 32.90), (3.11, 0.88), (1.48, 4.55))  # as printed, min and max, A.M.
AREAS = {"K.M.": 8712.30, "S.M.": 5884.10, "A.M.": 3770.80}  # mm², Table 2
SHARE = 64.08  # %, A.M. of S.M., text
WHERE = "Table 2"


def chapter(robot, tensions: int) -> Chapter:
    """Workspaces of fingertip and distal phalanx, whole and assisted. tensions: per wire."""
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
    with house_style():
        figure = workspace_figure(LENGTHS, SPONTANEOUS, wired)
        for axes in figure.axes:
            axes.grid(color=RULE, lw=0.5)
        drawn = render_svg(figure, "workspace", "workspace of the fingertip and of the distal phalanx")
    body = (Drawing(drawn, caption), "Table 2, printed beside ours", table)
    return Chapter("workspace", "Workspace: Fig. 13, Table 2", lead, body, table_2(wired))


def table_2(assisted) -> tuple[Claim, ...]:
    """The rows of Table 2, beside the `Assisted` of the simulated robot."""
    areas = {what: 1e6 * reach(LENGTHS, SPONTANEOUS, what).area for what in (FINGERTIP, DISTAL)}
    both = f"{areas[FINGERTIP]:.0f} fingertip, {areas[DISTAL]:.0f} distal phalanx"
    low, high = AREAS["S.M."] / areas[DISTAL], AREAS["K.M."] / areas[FINGERTIP]
    km = f"Pin joints, Table 1 lengths, S.M. ranges: printed is {high:.2f} times the fingertip's area, "
    km += f"{AREAS['K.M.'] / areas[DISTAL]:.2f} times what the whole distal phalanx sweeps."
    sm = (
        f"The printed area is {low:.2f} times all that its own ranges let the distal phalanx sweep, and measured motion"
        " lies inside. Our figure is that bound; the motion itself is not printed."
    )
    tip, bone = (1e6 * assisted.region(LENGTHS, what).area for what in (FINGERTIP, DISTAL))
    ours = f"{tip:.0f} fingertip, {bone:.0f} distal phalanx"
    ranges = ", ".join(f"{name} {low:.2f}..{high:.2f}" for name, (low, high) in assisted.ranges._asdict().items())
    printed = ", ".join(f"{name} {low:g}..{high:g}" for name, (low, high) in zip(Ranges._fields, ASSISTED, strict=True))
    beyond = int(np.sum(np.array(ASSISTED) > np.max(SPONTANEOUS)))
    why = f"PIP maximum below its minimum; {beyond} of 6 limits beyond the largest S.M. limit: not radians."
    area = (
        "Needs the A.M. motion, which is not printed. Ours is the nominal robot's statics over its tensions, joints"
        f" coupled by the wires; the full ranges give {areas[FINGERTIP]:.0f} (fingertip)."
    )
    ratio = f"{100 * AREAS['A.M.'] / AREAS['S.M.']:.2f}"
    return (
        Claim(WHERE, "K.M. area [mm²]", f"{AREAS['K.M.']:.2f}", both, DOES_NOT, km),
        Claim(WHERE, "S.M. area [mm²]", f"{AREAS['S.M.']:.2f}", f"at most {both}", DOES_NOT, sm),
        Claim(WHERE, "A.M. range [rad]", printed, ranges, DOES_NOT, why),
        Claim(WHERE, "A.M. area [mm²]", f"{AREAS['A.M.']:.2f}", ours, UNKNOWN, area),
        Claim(WHERE, "A.M. / S.M. [%]", f"{SHARE:.2f}", ratio, AGREES, "Quotient of the two printed areas."),
    )


HEAD = (
    "motion", "MCP printed [rad]", "PIP printed", "DIP printed", "area printed [mm²]", "ours: fingertip",
    "ours: distal phalanx",
)  # fmt: skip


def table_rows(wired) -> list[tuple[str, ...]]:
    """Rows under HEAD: ranges and areas as printed, and the areas that the ranges, or the wires, give."""
    kinds = (FINGERTIP, DISTAL)
    whole = [f"{1e6 * reach(LENGTHS, SPONTANEOUS, what).area:.0f}" for what in kinds]
    part = [f"{1e6 * wired.region(LENGTHS, what).area:.0f}" for what in kinds]
    ranges = [[f"{low:.2f} … {high:.2f}".replace("-", "−") for low, high in spans] for spans in (SPONTANEOUS, ASSISTED)]
    return [
        ("K.M., kinematically possible", "–", "–", "–", f"{AREAS['K.M.']:.2f}", *whole),
        ("S.M., spontaneous", *ranges[0], f"{AREAS['S.M.']:.2f}", *(f"at most {area}" for area in whole)),
        ("A.M., assisted", *ranges[1], f"{AREAS['A.M.']:.2f}", *part),
    ]
