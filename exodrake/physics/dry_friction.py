"""Dry friction as a loss of speed, which never turns motion round."""


def slowed(speed, loss):
    """Speed after it lost `loss` at most."""
    return speed - loss if speed > loss else speed + loss if speed < -loss else 0.0
