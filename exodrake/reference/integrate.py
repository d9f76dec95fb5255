"""Error-controlled integration in continuous time: a stabilised Runge-Kutta-Chebyshev pair, restarted at every task.

The robot is stiff in a simple way: joint damping on the light distal phalanges makes one real rate of about -12000
1/s (bristles and contact may add a few more), the rest is slower than 1000 1/s. RKC stretches its stability along the
negative real axis by taking more stages, so a step of 2 ms costs eight slopes and no Jacobian, and corners (clips,
slack wires, contact) do it no harm. The number of stages follows from a fixed guess of the spectral radius; should
the true one be larger, the error control rejects and shortens the step. Checked against Radau in the tests. Source:
Sommeijer, Shampine and Verwer, J. Comput. Appl. Math. 88, 1998 (RKC).
"""

from math import ceil, sqrt

import numpy as np
from numba import njit

from exodrake.reference.dynamics import derivative
from exodrake.reference.robot import INPUT_SIZE

RELATIVE = 1e-3
RADIUS = 1.5e4  # 1/s, guess of the spectral radius, with a margin for drawn parameters
DAMPING = 2.0 / 13.0  # of the Chebyshev polynomials, as in the paper
SAFETY, SHRINK, GROW = 0.8, 0.1, 5.0
SMALLEST = 1e-9  # s


@njit(cache=True)
def workspace(size):
    """Scratch: slope at the start, slope of a stage, three stages, new state; inputs, torque, arms."""
    return np.zeros((6, size)), np.zeros(INPUT_SIZE), np.zeros(3), np.zeros((3, 3))


@njit(cache=True)
def chebyshev(w0, before, last):
    """Next T, T', T'' at w0 from the last two."""
    value = 2.0 * w0 * last[0] - before[0]
    slope = 2.0 * w0 * last[1] - before[1] + 2.0 * last[0]
    return value, slope, 2.0 * w0 * last[2] - before[2] + 4.0 * last[1]


@njit(cache=True)
def end_of_chebyshev(w0, stages):
    """T, T', T'' of the highest order at w0."""
    before, last = (1.0, 0.0, 0.0), (w0, 1.0, 0.0)
    for _ in range(2, stages + 1):
        before, last = last, chebyshev(w0, before, last)
    return last


@njit(cache=True)
def first_stage(y, step, share, slope, older, old):
    """Stages 0 and 1."""
    for i in range(y.size):
        older[i] = y[i]
        old[i] = y[i] + share * step * slope[i]


@njit(cache=True)
def mix(out, y, old, older, mu, nu, first, second, slope, start):
    """One recursion of the stages; first and second are already times the step."""
    rest = 1.0 - mu - nu
    for i in range(y.size):
        out[i] = rest * y[i] + mu * old[i] + nu * older[i] + first * slope[i] + second * start[i]


@njit(cache=True)
def trial(time, y, step, p, command, inputs, work):
    """One RKC step from slope work[0]; the index of the row that holds the new state. Its slope is not yet known."""
    rows, u, torque, arms = work
    start, slope = rows[0], rows[1]
    stages = max(2, 1 + ceil(sqrt(1.0 + 1.54 * step * RADIUS)))
    w0 = 1.0 + DAMPING / stages**2
    _, top_slope, top_curve = end_of_chebyshev(w0, stages)
    w1 = top_slope / top_curve
    before, last = (1.0, 0.0, 0.0), (w0, 1.0, 0.0)
    b_first = 1.0 / (4.0 * w0 * w0)  # b0 = b1 = b2
    b_older, b_old = b_first, b_first
    older, old, new = 2, 3, 4
    first_stage(y, step, b_first * w1, start, rows[older], rows[old])
    moment = b_first * w1
    for _ in range(2, stages + 1):
        derivative(time + moment * step, rows[old], slope, p, command, inputs, u, torque, arms)
        gone = 1.0 - b_old * last[0]
        before, last = last, chebyshev(w0, before, last)
        b = last[2] / (last[1] * last[1])
        reach = 2.0 * b * w1 / b_old
        mu, nu = 2.0 * b * w0 / b_old, -b / b_older
        mix(rows[new], y, rows[old], rows[older], mu, nu, reach * step, -gone * reach * step, slope, start)
        moment = w1 * last[2] / last[1]
        b_older, b_old = b_old, b
        older, old, new = old, new, older
    return old


@njit(cache=True)
def scaled_error(y, new, start, end, step, tolerance):
    """Largest error of a step in units of what is tolerated; <= 1 accepts."""
    worst = 0.0
    for i in range(y.size):
        error = 0.8 * (y[i] - new[i]) + 0.4 * step * (start[i] + end[i])
        worst = max(worst, abs(error) / (tolerance[i] + RELATIVE * abs(new[i])))
    return worst if worst < 1e12 else 1e12


@njit(cache=True)
def advance(time, until, y, step, p, command, inputs, tolerance, work):
    """Integrate y in place from time to until [s]; returns the step to try next, or -1 if it cannot be done."""
    rows, u, torque, arms = work
    derivative(time, y, rows[0], p, command, inputs, u, torque, arms)
    left = until - time
    while left > SMALLEST:
        size = min(step, left)
        if size > 0.5 * left and size < left:
            size = 0.5 * left
        new = rows[trial(time, y, size, p, command, inputs, work)]
        derivative(time + size, new, rows[5], p, command, inputs, u, torque, arms)
        worst = scaled_error(y, new, rows[0], rows[5], size, tolerance)
        factor = min(GROW, max(SHRINK, SAFETY * (worst + 1e-10) ** (-1.0 / 3.0)))
        if worst <= 1.0:
            time += size
            left = until - time
            y[:] = new
            rows[0, :] = rows[5]
            step = max(step, size * factor) if size < step else size * factor
        else:
            step = size * factor
            if step < SMALLEST:
                return -1.0
    return step
