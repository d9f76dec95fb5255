"""Errors of a signal: gain, offset, drift, lag, delay, packet loss, crosstalk, dead zone, saturation, backlash."""
