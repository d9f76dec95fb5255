"""Where the fingertip and the distal phalanx can go (paper Table 2, Fig. 13).

`chain` places the finger, `area` measures what a range of motion reaches, exactly by polygon union and by Monte Carlo,
`assisted` finds the postures the wires can hold, `printed` compares with the paper, `figure` draws.
"""

from exodrake.identification.workspace.area import Area, monte_carlo, reach, traced
from exodrake.identification.workspace.assisted import Assisted, assisted
from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, Ranges, tip
from exodrake.identification.workspace.printed import Claim, table_2

__all__ = [
    "DISTAL",
    "FINGERTIP",
    "Area",
    "Assisted",
    "Claim",
    "Ranges",
    "assisted",
    "monte_carlo",
    "reach",
    "table_2",
    "tip",
    "traced",
]
