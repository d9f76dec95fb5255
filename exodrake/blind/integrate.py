"""Error-controlled integration in continuous time: Bogacki-Shampine 3(2) with a step-size controller, restarted at
every task instant.

The robot is mildly stiff (joint damping on a light phalanx 2400 1/s, bristles and contact a few times that) and full
of corners (clips, slack wires, contact), and is interrupted every 2 ms anyway. A low-order explicit pair then costs
less than a Rosenbrock step with its Jacobian; its error control finds the stability limit by itself. Checked against
scipy's Radau in the tests. Source: Bogacki and Shampine, Appl. Math. Lett. 2(4), 1989.
"""

import numpy as np
from numba import njit

from exodrake.blind.field import derivative
from exodrake.blind.layout import INPUT_SIZE

RELATIVE = 1e-3
SAFETY, SHRINK, GROW = 0.85, 0.2, 3.0
SMALLEST = 1e-9  # s


@njit(cache=True)
def workspace(size):
    """Scratch: four slopes, trial state, new state; inputs, torque, arms."""
    return np.zeros((6, size)), np.zeros(INPUT_SIZE), np.zeros(3), np.zeros((3, 3))


@njit(cache=True)
def trial(time, y, step, p, command, inputs, tolerance, work):
    """One Bogacki-Shampine step from slope work[0]; the new state goes to work[5]; returns the scaled error (<= 1
    accepts).
    """
    stages, u, torque, arms = work
    k1, k2, k3, k4, middle, new = stages[0], stages[1], stages[2], stages[3], stages[4], stages[5]
    for i in range(y.size):
        middle[i] = y[i] + 0.5 * step * k1[i]
    derivative(time + 0.5 * step, middle, k2, p, command, inputs, u, torque, arms)
    for i in range(y.size):
        middle[i] = y[i] + 0.75 * step * k2[i]
    derivative(time + 0.75 * step, middle, k3, p, command, inputs, u, torque, arms)
    for i in range(y.size):
        new[i] = y[i] + step * (2.0 * k1[i] + 3.0 * k2[i] + 4.0 * k3[i]) / 9.0
    derivative(time + step, new, k4, p, command, inputs, u, torque, arms)
    worst = 0.0
    for i in range(y.size):
        error = step * (-5.0 * k1[i] / 72.0 + k2[i] / 12.0 + k3[i] / 9.0 - k4[i] / 8.0)
        worst = max(worst, abs(error) / (tolerance[i] + RELATIVE * abs(new[i])))
    return worst


@njit(cache=True)
def advance(time, until, y, step, p, command, inputs, tolerance, work):
    """Integrate y in place from time to until [s]; returns the step to try next, or -1 if the state cannot be
    integrated.
    """
    stages, u, torque, arms = work
    derivative(time, y, stages[0], p, command, inputs, u, torque, arms)
    left = until - time
    while left > SMALLEST:
        size = min(step, left)
        if size > 0.5 * left and size < left:
            size = 0.5 * left
        worst = trial(time, y, size, p, command, inputs, tolerance, work)
        if not worst < 1e12:
            worst = 1e12
        factor = min(GROW, max(SHRINK, SAFETY * (worst + 1e-10) ** (-1.0 / 3.0)))
        if worst <= 1.0:
            time += size
            left = until - time
            y[:] = stages[5]
            stages[0, :] = stages[3]
            step = max(step, size * factor) if size < step else size * factor
        else:
            step = size * factor
            if step < SMALLEST:
                return -1.0
    return step
