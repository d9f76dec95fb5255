"""Levels of tests and confidence of intervals, for the diagnosis, the changes of a fleet, the monitor and reports."""

ALPHA = 0.02  # level of each test: chosen
CONFIDENCE = 0.9  # of intervals and of sets of dates: chosen
NORMAL_90 = 1.6448536269514722  # standard deviations from the middle of an interval to its ends, normal law
NORMAL_95 = 1.959963984540054
