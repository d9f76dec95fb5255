"""Kinematics from skin markers: `markers` reads them, `identify` estimates, `report` writes; `rigid` has the motions."""
