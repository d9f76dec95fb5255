"""Levels of tests, confidence of intervals, and exact binomial intervals."""

ALPHA = 0.02  # level of each test: chosen
CONFIDENCE = 0.9  # of intervals and of sets of dates: chosen
NORMAL_90 = 1.6448536269514722  # standard deviations from the middle of an interval to its ends, normal law
NORMAL_95 = 1.959963984540054


def binomial_interval(hits: int, total: int) -> tuple[float, float]:
    """Exact 95 % interval of a share (Clopper & Pearson 1934); (0, 1) for no trials."""
    from scipy.stats import binomtest

    if not total:
        return 0.0, 1.0
    found = binomtest(hits, total).proportion_ci(0.95)
    return float(found.low), float(found.high)
