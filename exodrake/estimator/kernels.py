"""Covariance of the angles: a function of the inputs, plus a random offset and drift per sweep, plus noise.

    k = v_lin (1 + z . z') + v_rbf exp(-|(z - z') / ell|^2 / 2)
        + [same sweep] (v_sweep + v_drift exp(-|t - t'| / tau)) + v_noise [same row]

It is a composition of scikit-learn's kernels and two more: a kernel on some columns, and an indicator of equal labels.
Rows are (z (m columns), sweep label, time [s]). Without the middle terms the length scales absorb the correlated error
of a sweep, and more data makes a new sweep worse.
"""

import numpy as np
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    Hyperparameter,
    Kernel,
    Matern,
    Sum,
    WhiteKernel,
)


class OnColumns(Kernel):
    """Kernel on some columns of its input."""

    def __init__(self, kernel, columns):
        self.kernel = kernel
        self.columns = columns

    def get_params(self, deep=True):
        """Parameters, those of the inner kernel as `kernel__...`."""
        inner = {f"kernel__{name}": value for name, value in self.kernel.get_params().items()} if deep else {}
        return {"kernel": self.kernel, "columns": self.columns, **inner}

    @property
    def hyperparameters(self):
        """Hyperparameters of the inner kernel."""
        return [
            Hyperparameter(f"kernel__{h.name}", h.value_type, h.bounds, h.n_elements)
            for h in self.kernel.hyperparameters
        ]

    @property
    def theta(self):
        """Logarithms of the hyperparameters."""
        return self.kernel.theta

    @theta.setter
    def theta(self, theta):
        self.kernel.theta = theta

    @property
    def bounds(self):
        """Bounds (p, 2) of theta."""
        return self.kernel.bounds

    def __call__(self, X, Y=None, eval_gradient=False):
        """Covariance (n, m) of rows X (n, columns) and Y (m, columns)."""
        columns = list(self.columns)
        return self.kernel(X[:, columns], None if Y is None else Y[:, columns], eval_gradient)

    def diag(self, X):
        """Prior variances (n,)."""
        return self.kernel.diag(X[:, list(self.columns)])

    def is_stationary(self):
        """Tell whether the inner kernel is stationary."""
        return self.kernel.is_stationary()


class SameLabel(Kernel):
    """Kernel that is 1 for equal labels in a column and 0 otherwise."""

    def __init__(self, column):
        self.column = column

    def __call__(self, X, Y=None, eval_gradient=False):
        """Covariance (n, m) of rows X (n, columns) and Y (m, columns)."""
        other = X if Y is None else Y
        value = (X[:, self.column, None] == other[None, :, self.column]).astype(float)
        return (value, np.empty((*value.shape, 0))) if eval_gradient else value

    def diag(self, X):
        """Ones (n,)."""
        return np.ones(len(X))

    def is_stationary(self):
        """Return False."""
        return False


def sweep_kernel(inputs: int) -> Sum:
    """Build the covariance for `inputs` columns z and angles of unit variance, with start values and bounds."""
    z, sweep, time = tuple(range(inputs)), inputs, (inputs + 1,)
    linear = ConstantKernel(1.0, (1e-3, 1e3)) * OnColumns(DotProduct(1.0, "fixed"), z)
    length = RBF(np.full(inputs, 2.0), (5e-2, 1e2))  # pyright: ignore
    curved = ConstantKernel(1.0, (1e-4, 1e3)) * OnColumns(length, z)
    shared = ConstantKernel(1e-2, (1e-6, 1.0)) * SameLabel(sweep)
    drift = ConstantKernel(1e-2, (1e-6, 1.0)) * SameLabel(sweep) * OnColumns(Matern(1.0, (5e-2, 50.0), nu=0.5), time)
    return linear + curved + shared + drift + WhiteKernel(1e-3, (1e-7, 1.0))


def parts(kernel: Sum) -> tuple[float, float, np.ndarray, float]:
    """Read (v_lin, v_rbf, ell (m,), v_sweep + v_drift + v_noise) of a `sweep_kernel` [-]."""
    without_noise, noise = kernel.k1, kernel.k2
    without_drift, drift = without_noise.k1, without_noise.k2
    explained, shared = without_drift.k1, without_drift.k2
    linear, curved = explained.k1, explained.k2
    rest = shared.k1.constant_value + drift.k1.k1.constant_value + noise.noise_level
    return linear.k1.constant_value, curved.k1.constant_value, np.atleast_1d(curved.k2.kernel.length_scale), rest
