"""Joint-angle estimator: three tensions and three strokes in, three angles and their standard deviations out.

A Gaussian process, already trained (`identification.estimator.gp`), reduced to flat arrays:

    x = (T, s)      z = R (x - c)      k_i = v_lin (1 + z . z_i) + v_rbf exp(-|(z - z_i) / ell|^2 / 2)
    mean_j = o_j + g_j sum_i k_i alpha_ij
    std_j  = p_j sqrt(v_lin (1 + z . z) + v_rbf + v_rest - |L^-1 k|^2)

The sweep a new sample belongs to was never seen, so the covariance with the training points holds the linear and RBF
part only, while the prior variance v_rest holds the per-sweep constant, the slow drift and the white noise. Sums run
in a fixed order and without fast-math, so Drake leaf and compiled simulator agree to the last bit; columns of L^-1 are
packed so that the inner loop is a plain a += b c, which vectorises. No BLAS: no threads, no spikes.
"""

from math import exp, nan, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit


class Weights(NamedTuple):
    """A trained estimator of m = 2 x wires inputs, n training points, J joints.

    center (m,) [N and m]; rotation (m, m) [1/N and 1/m]; points (m, n) z_i as columns; shrink (m,) 1/ell; variances
    (3,) v_lin, v_rbf, v_rest [-]; alpha (n, J) [-]; factor (n (n + 1) / 2,) columns of the lower triangle L^-1;
    offset, gain, spread (J,) [rad].
    """

    center: np.ndarray
    rotation: np.ndarray
    points: np.ndarray
    shrink: np.ndarray
    variances: np.ndarray
    alpha: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    gain: np.ndarray
    spread: np.ndarray


def scratch(weights: Weights) -> np.ndarray:
    """Working memory of `predict_into`, (3, n)."""
    return np.empty((3, weights.alpha.shape[0]))


@njit(cache=True)
def predict_into(tension, stroke, weights, work, mean, std):
    """Write mean and standard deviation (J,) [rad] of one sample; tension [N], stroke [m] (tendons,).

    `work` comes from `scratch`. Allocates nothing. A NaN among the inputs gives NaN in both. Returns the variance
    ratio: predictive variance over v_rest [-], about 1 where the training sweeps lie and larger away from them;
    `Estimator.limit` is compared with it.
    """
    points, shrink, variances = weights.points, weights.shrink, weights.variances
    covariance, square, whitened = work[0], work[1], work[2]
    wires, size = tension.shape[0], covariance.shape[0]
    covariance[:] = variances[0]
    square[:] = 0.0
    whitened[:] = 0.0
    own = 1.0
    for row in range(2 * wires):
        z = 0.0
        for wire in range(wires):
            z += weights.rotation[row, wire] * (tension[wire] - weights.center[wire])
            z += weights.rotation[row, wires + wire] * (stroke[wire] - weights.center[wires + wire])
        own += z * z
        slope, narrow, coordinate = variances[0] * z, shrink[row], points[row]
        for i in range(size):
            covariance[i] += slope * coordinate[i]
            apart = (z - coordinate[i]) * narrow
            square[i] += apart * apart
    for i in range(size):
        covariance[i] += variances[1] * exp(-0.5 * square[i])
    start = 0
    for j in range(size):
        column, target, here = weights.factor[start : start + size - j], whitened[j:], covariance[j]
        for i in range(size - j):
            target[i] += column[i] * here
        start += size - j
    explained = 0.0
    for i in range(size):
        explained += whitened[i] * whitened[i]
    variance = variances[0] * own + variances[1] + variances[2] - explained
    deviation = sqrt(variance) if variance >= 0.0 else nan
    for joint in range(mean.shape[0]):
        total = 0.0
        for i in range(size):
            total += covariance[i] * weights.alpha[i, joint]
        mean[joint] = weights.offset[joint] + weights.gain[joint] * total
        std[joint] = weights.spread[joint] * deviation
    return variance / variances[2]


@njit(cache=True)
def predict_rows(tension, stroke, weights):
    """Mean (rows, J), deviation (rows, J) [rad], variance ratio (rows,); tension [N], stroke [m] (rows, tendons)."""
    rows, joints = tension.shape[0], weights.offset.shape[0]
    mean, std, ratio = np.empty((rows, joints)), np.empty((rows, joints)), np.empty(rows)
    work = np.empty((3, weights.alpha.shape[0]))
    for row in range(rows):
        ratio[row] = predict_into(tension[row], stroke[row], weights, work, mean[row], std[row])
    return mean, std, ratio
