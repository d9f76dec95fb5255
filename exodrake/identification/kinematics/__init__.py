"""Kinematics from skin markers: `markers` reads, `identify` estimates, `report` writes; `rigid` has the motions."""
