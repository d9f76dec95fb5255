"""How good a loop could be: a bound on settling, and LQG with the same sensors, delays and noise of the commands.

The bound is a linear programme. On the linear plant at rest, delays and sample rate included, it looks for commands

    |v(k)| <= peak      y(k) <= 1 + overshoot      |y(k) - 1| <= 2 %  for k >= n

with the least n, for a step of one reference; other channels may do what they like, and there is no noise. No
controller, linear or not, that moves its commands as little and overshoots as little settles sooner on that plant.
LQG is a design that can be built: states estimated from the noisy readings, integral action, the reference fed forward.
"""

from __future__ import annotations

import control
import numpy as np

from exodrake.analysis.linear_model import System
from exodrake.analysis.responses import BAND

ROUNDING = 1e-6  # of a step, by which the programme may miss its limits


def bound_settling(plant: System, channel: int, peak: float, overshoot: float, crosstalk: float, frames: int) -> float:
    """Least time [s] in which a channel can settle to 2 % of a unit step; nan if not within `frames`.

    Args:
        plant: from commands to readings.
        channel: whose reference steps.
        peak: largest command [command / step].
        overshoot: largest, as a fraction of the step.
        crosstalk: largest reading of another channel, as a fraction of the step.
        frames: horizon, to whose end the reading stays settled.
    """
    from scipy.optimize import linprog

    m, pulse, x = plant.ninputs, np.zeros((frames, plant.ninputs, plant.ninputs)), np.array(plant.B)
    for k in range(frames):
        pulse[k], x = plant.C @ x, plant.A @ x
    after, before = np.tril_indices(frames)
    answer = np.zeros((m, frames, frames, m))  # readings at the end of a frame from the commands of another, of peak 1
    answer[:, after, before] = peak * pulse[after - before].transpose(1, 0, 2)
    answer = answer.reshape(m, frames, frames * m)
    others = np.delete(answer, channel, axis=0).reshape(-1, frames * m)

    def feasible(n: int) -> bool:
        above = 1.0 + np.where(np.arange(frames) >= n, min(BAND, overshoot), overshoot)
        rows = np.vstack([answer[channel], -answer[channel, n:], others, -others])
        limits = np.concatenate([above, np.full(frames - n, BAND - 1.0), np.full(2 * len(others), crosstalk)])
        rows = np.column_stack([rows, -np.ones(len(rows))])  # all limits may be missed by as much, the least possible
        bounds = [(-1.0, 1.0)] * (frames * m) + [(0.0, None)]
        for method in ("highs-ds", "highs-ipm"):  # either gives up now and then
            found = linprog(np.eye(frames * m + 1)[-1], rows, limits, bounds=bounds, method=method)
            if found.status == 0:
                return found.fun < ROUNDING
        return False

    low, high = -1, frames - 1
    if not feasible(high):
        return float("nan")
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if feasible(middle) else (middle, high)
    return plant.dt * (high + 1)


def design_lqg(
    plant: System, noise: tuple[np.ndarray, np.ndarray], effort: float, integral: float, disturbance: float
) -> System:
    """LQG controller with integral action, from readings and references to commands.

    It minimises the mean of |y - r|^2 + integral |E|^2 + effort |v|^2; states are estimated by a Kalman filter. The
    reference enters by the state and the command that hold it. E sums the readings' distance from the undisturbed
    answer, so that a step of the reference leaves it at 0.

    Args:
        plant: from commands to readings.
        noise: N (n, noises) and M (channels, noises) of the plant, for noise of unit variance.
        effort: weight of the commands [(reading / command)^2].
        integral: weight of the integral [-].
        disturbance: standard deviation of white noise added to the commands [command].

    Raises:
        LinAlgError: where the Riccati equations have no solution.
    """
    a, b, c, n, m = plant.A, plant.B, plant.C, plant.nstates, plant.ninputs
    weights = np.zeros((n + m, n + m))
    weights[:n, :n], weights[n:, n:] = c.T @ c, integral * np.eye(m)
    whole = np.block([[a, np.zeros((n, m))], [c, np.eye(m)]])
    gain = control.dlqr(whole, np.vstack([b, np.zeros((m, m))]), weights, effort * np.eye(m))[0]
    process = noise[0] @ noise[0].T + disturbance**2 * b @ b.T
    kalman = control.dlqe(a, np.eye(n), c, 0.5 * (process + process.T), noise[1] @ noise[1].T)[0]
    hold = np.linalg.lstsq(np.block([[a - np.eye(n), b], [c, np.zeros((m, m))]]),
                           np.vstack([np.zeros((n, m)), np.eye(m)]), rcond=None)[0]  # fmt: skip
    state, total = gain[:, :n], gain[:, n:]
    feed, ideal = state @ hold[:n] + hold[n:], a - b @ state
    dynamics = np.block([[ideal - kalman @ c, -b @ total, np.zeros((n, n))], [np.zeros((m, n)), np.eye(m), -c],
                         [np.zeros((n, n + m)), ideal]])  # fmt: skip
    inputs = np.block([[kalman, b @ feed], [np.eye(m), np.zeros((m, m))], [np.zeros((n, m)), b @ feed]])
    rows = np.hstack([-gain, np.zeros((m, n))])
    return System(dynamics, inputs, rows, np.hstack([np.zeros((m, m)), feed]), plant.dt)
