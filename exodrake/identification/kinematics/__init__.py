"""Kinematic identification: joint axes, moving joint centres, angles and phalanx lengths from markers on the skin
(paper 2.2.1).

`read_markers` reads a recording, `identify` finds the finger in it, `report` writes table, robot file and figure;
`synthesise` makes recordings with a known truth. The theory is on the pages `screws`, `frames`, `axis`, `hinge`,
`newton`, `two_axis` and `line`.
"""
