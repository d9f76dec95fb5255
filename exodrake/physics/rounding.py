"""Resolution of a digital reading."""

from math import floor


def rounded(value, step):
    """Value rounded to the nearest multiple of step; unchanged where step is 0."""
    if step > 0.0:
        return floor(value / step + 0.5) * step
    return value
