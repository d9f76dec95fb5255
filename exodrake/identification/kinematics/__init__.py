"""Kinematic identification from skin markers: joint axes, centres, angles and phalanx lengths (paper 2.2.1).

`markers.read_markers` reads a recording, `identify.identify` estimates the finger's kinematics, `report` writes
table, robot file and figure, and `synthetic.synthesise` makes recordings with known truth. The theory is in `rigid`
`screws` and `adjust`.
"""
