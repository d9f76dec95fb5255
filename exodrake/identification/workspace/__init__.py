"""Workspaces of the fingertip and the distal phalanx (paper Table 2, Fig. 13).

`chain` has the kinematics, `area` the area within a range of motion (polygon union and Monte Carlo), and `assisted` the
postures in static equilibrium with the wires.
"""

from exodrake.identification.workspace.area import Area, monte_carlo, reach, traced
from exodrake.identification.workspace.assisted import Assisted, assisted
from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, LENGTHS, SPONTANEOUS, Ranges, tip

__all__ = [
    "DISTAL",
    "FINGERTIP",
    "LENGTHS",
    "SPONTANEOUS",
    "Area",
    "Assisted",
    "Ranges",
    "assisted",
    "monte_carlo",
    "reach",
    "tip",
    "traced",
]
