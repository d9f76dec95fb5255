"""Shares of trials and their exact binomial intervals."""


def binomial_interval(hits: int, total: int) -> tuple[float, float]:
    """Exact 95 % interval of a share (Clopper & Pearson 1934); (0, 1) for no trials."""
    from scipy.stats import binomtest

    if not total:
        return 0.0, 1.0
    found = binomtest(hits, total).proportion_ci(0.95)
    return float(found.low), float(found.high)
