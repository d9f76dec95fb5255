"""A signal some samples late, between samples the two neighbours mixed."""

DEPTH = 8  # samples that a late signal remembers


def remembered(value, clock, history):
    """The value and those of the samples before it, the newest first; before the first sample it was always so."""
    if clock == 0.0:
        return value, value, value, value, value, value, value, value, value
    return value, history[0], history[1], history[2], history[3], history[4], history[5], history[6], history[7]


def late(samples, values):
    """Value that many samples ago, at most `DEPTH`; for a clock that is ahead (< 0) the line through the last two."""
    if samples <= 0.0:
        return values[0] - samples * (values[0] - values[1])
    whole = min(int(samples), DEPTH - 1)
    part = min(samples - whole, 1.0)
    return (1.0 - part) * values[whole] + part * values[whole + 1]


def delayed(value, clock, samples, history):
    """The late value, then the history that the next sample will see."""
    values = remembered(value, clock, history)
    shown = late(samples, values)
    return shown, values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7]
