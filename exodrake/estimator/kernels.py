"""Covariance of the angles: what the inputs explain, and what the rows of one sweep share besides.

    k = v_lin (1 + z . z') + v_rbf exp(-|(z - z') / ell|^2 / 2)
        + [same sweep] (v_sweep + v_drift exp(-|t - t'| / tau)) + v_noise [same row]

scikit-learn's kernels compose all of it; the two here let a kernel look at some columns only, and at equal labels.
Rows are (z (m columns), sweep label, time [s]); a label that no training row has (`NEW`) stands for a new sweep.
Without the middle terms the length scales absorb what a sweep's rows share, and more data makes a new sweep worse.
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

NEW = -1.0


class OnColumns(Kernel):
    """A kernel that sees some columns of its input only."""

    def __init__(self, kernel, columns):
        self.kernel = kernel
        self.columns = columns

    def get_params(self, deep=True):
        """Parameters, those of the inner kernel as `kernel__...`."""
        inner = {f"kernel__{name}": value for name, value in self.kernel.get_params().items()} if deep else {}
        return {"kernel": self.kernel, "columns": self.columns, **inner}

    @property
    def hyperparameters(self):
        """Those of the inner kernel."""
        return [
            Hyperparameter(f"kernel__{h.name}", h.value_type, h.bounds, h.n_elements)
            for h in self.kernel.hyperparameters
        ]

    @property
    def theta(self):
        """Free parameters, as logarithms."""
        return self.kernel.theta

    @theta.setter
    def theta(self, theta):
        self.kernel.theta = theta

    @property
    def bounds(self):
        """Bounds of theta, (p, 2)."""
        return self.kernel.bounds

    def __call__(self, X, Y=None, eval_gradient=False):
        columns = list(self.columns)
        return self.kernel(X[:, columns], None if Y is None else Y[:, columns], eval_gradient)

    def diag(self, X):
        """Prior variances, (n,)."""
        return self.kernel.diag(X[:, list(self.columns)])

    def is_stationary(self):
        """As the inner kernel."""
        return self.kernel.is_stationary()


class SameLabel(Kernel):
    """1 where a column holds the same label, else 0; no free parameter."""

    def __init__(self, column):
        self.column = column

    def __call__(self, X, Y=None, eval_gradient=False):
        other = X if Y is None else Y
        value = (X[:, self.column, None] == other[None, :, self.column]).astype(float)
        return (value, np.empty((*value.shape, 0))) if eval_gradient else value

    def diag(self, X):
        """Ones, (n,)."""
        return np.ones(len(X))

    def is_stationary(self):
        """No."""
        return False


def sweep_kernel(inputs: int) -> Sum:
    """The covariance above for `inputs` columns z of about unit size and angles scaled to unit variance; start values
    and bounds."""
    z, sweep, time = tuple(range(inputs)), inputs, (inputs + 1,)
    linear = ConstantKernel(1.0, (1e-3, 1e3)) * OnColumns(DotProduct(1.0, "fixed"), z)
    length = RBF(np.full(inputs, 2.0), (5e-2, 1e2))  # pyright: ignore
    curved = ConstantKernel(1.0, (1e-4, 1e3)) * OnColumns(length, z)
    shared = ConstantKernel(1e-2, (1e-6, 1.0)) * SameLabel(sweep)
    drift = ConstantKernel(1e-2, (1e-6, 1.0)) * SameLabel(sweep) * OnColumns(Matern(1.0, (5e-2, 50.0), nu=0.5), time)
    return linear + curved + shared + drift + WhiteKernel(1e-3, (1e-7, 1.0))


def parts(kernel: Sum) -> tuple[float, float, np.ndarray, float]:
    """(v_lin, v_rbf, ell (m,), v_rest) of a `sweep_kernel`; v_rest = v_sweep + v_drift + v_noise."""
    without_noise, noise = kernel.k1, kernel.k2
    without_drift, drift = without_noise.k1, without_noise.k2
    explained, shared = without_drift.k1, without_drift.k2
    linear, curved = explained.k1, explained.k2
    rest = shared.k1.constant_value + drift.k1.k1.constant_value + noise.noise_level
    return linear.k1.constant_value, curved.k1.constant_value, np.atleast_1d(curved.k2.kernel.length_scale), rest
