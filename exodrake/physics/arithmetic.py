"""Arithmetic that several parts share: rounding, dry friction, histories, and vectors and matrices of three.

Vectors are tuples of floats, which numba keeps in registers.
"""

from math import floor

GRAVITY = 9.81  # m/s2, as Drake has it


def round_to(value, step):
    """Value rounded to the nearest multiple of step; unchanged where step is 0."""
    return floor(value / step + 0.5) * step if step > 0.0 else value


def brake_dry(speed, loss):
    """Speed after dry friction took `loss` from it, which never turns motion round."""
    return speed - loss if speed > loss else speed + loss if speed < -loss else 0.0


def remember(x, first, depth, value):
    """Put a value before the newest of a history of `depth` values that begins at x[first]."""
    for k in range(first + depth - 1, first, -1):
        x[k] = x[k - 1]
    x[first] = value


def add(a, b):
    """Sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def multiply(s, a):
    """Product s a."""
    return s * a[0], s * a[1], s * a[2]


def dot(a, b):
    """Scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    """Vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def column(rows, i):
    """Column i of three triples."""
    return rows[0][i], rows[1][i], rows[2][i]


def solve(m, r):
    """Solution of a 3 x 3 linear system given as rows, by Cramer's rule."""
    (a, b, c), (d, f, g), (h, k, p) = m
    u, v, w = f * p - g * k, g * h - d * p, d * k - f * h
    inverse = 1.0 / (a * u + b * v + c * w)
    x = (u * r[0] + (c * k - b * p) * r[1] + (b * g - c * f) * r[2]) * inverse
    y = (v * r[0] + (a * p - c * h) * r[1] + (c * d - a * g) * r[2]) * inverse
    return x, y, (w * r[0] + (b * h - a * k) * r[1] + (a * f - b * d) * r[2]) * inverse


def quotient(here, there, step):
    """Difference quotient (there - here) / step of triples."""
    return (there[0] - here[0]) / step, (there[1] - here[1]) / step, (there[2] - here[2]) / step
