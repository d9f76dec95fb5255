"""Quantiles of the normal distribution, in standard deviations from the middle of an interval to its ends."""

NORMAL_90 = 1.6448536269514722
NORMAL_95 = 1.959963984540054
