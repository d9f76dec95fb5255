"""Comparison with the paper's Table 2: what follows from other printed values (`physics.md` section 2)."""

import numpy as np

from exodrake.identification.workspace import DISTAL, FINGERTIP, LENGTHS, SPONTANEOUS, Ranges, reach
from studies.paper.claim import AGREES, DOES_NOT, UNKNOWN, Claim

ASSISTED = ((21.27, 32.90), (3.11, 0.88), (1.48, 4.55))  # as printed, min and max, A.M.
AREAS = {"K.M.": 8712.30, "S.M.": 5884.10, "A.M.": 3770.80}  # mm², Table 2
SHARE = 64.08  # %, A.M. of S.M., text
WHERE = "Table 2"


def table_2(assisted=None) -> tuple[Claim, ...]:
    """List the rows of Table 2; `assisted` is an `Assisted` of the simulated robot, or None for empty cells."""
    areas = {what: 1e6 * reach(LENGTHS, SPONTANEOUS, what).area for what in (FINGERTIP, DISTAL)}
    both = f"{areas[FINGERTIP]:.0f} fingertip, {areas[DISTAL]:.0f} distal phalanx"
    low, high = AREAS["S.M."] / areas[DISTAL], AREAS["K.M."] / areas[FINGERTIP]
    km = f"Pin joints, Table 1 lengths, S.M. ranges: printed is {high:.2f} times the fingertip's area, "
    km += f"{AREAS['K.M.'] / areas[DISTAL]:.2f} times what the whole distal phalanx sweeps."
    sm = (
        f"The printed area is {low:.2f} times all that its own ranges let the distal phalanx sweep, and measured motion"
        " lies inside. Our figure is that bound; the motion itself is not printed."
    )
    return (
        Claim(WHERE, "K.M. area [mm²]", f"{AREAS['K.M.']:.2f}", both, DOES_NOT, km),
        Claim(WHERE, "S.M. area [mm²]", f"{AREAS['S.M.']:.2f}", f"at most {both}", DOES_NOT, sm),
        *_assisted_rows(assisted, areas),
        _share(),
    )


def _assisted_rows(assisted, areas: dict[str, float]) -> list[Claim]:
    ours = ranges = "-"
    if assisted is not None:
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
    return [
        Claim(WHERE, "A.M. range [rad]", printed, ranges, DOES_NOT, why),
        Claim(WHERE, "A.M. area [mm²]", f"{AREAS['A.M.']:.2f}", ours, UNKNOWN, area),
    ]


def _share() -> Claim:
    ratio = 100 * AREAS["A.M."] / AREAS["S.M."]
    return Claim(WHERE, "A.M. / S.M. [%]", f"{SHARE:.2f}", f"{ratio:.2f}", AGREES, "Quotient of the two printed areas.")
