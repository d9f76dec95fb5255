"""Kinematic identification from skin markers: `markers` reads, `identify` estimates, `report` writes; poses in `rigid`."""
