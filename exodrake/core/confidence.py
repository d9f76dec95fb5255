"""Levels of tests and confidence of intervals, for the diagnosis, the changes of a fleet, the monitor and reports."""

ALPHA = 0.02  # level of each test: chosen
CONFIDENCE = 0.9  # of intervals and of sets of dates: chosen
