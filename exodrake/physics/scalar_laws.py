"""Laws of one value that several parts share: the resolution of a reading, and dry friction."""

from math import floor


def rounded(value, step):
    """Value rounded to the nearest multiple of step; unchanged where step is 0."""
    if step > 0.0:
        return floor(value / step + 0.5) * step
    return value


def slowed(speed, loss):
    """Speed after dry friction took `loss` from it, which never turns motion round."""
    return speed - loss if speed > loss else speed + loss if speed < -loss else 0.0
