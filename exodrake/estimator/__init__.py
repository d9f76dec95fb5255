"""Joint-angle estimator: a Gaussian process from tensions and strokes to joint angles with standard deviations.

    logs -> `dataset.sweeps_from_logs` -> `gp.fit` -> `gp.estimator_bytes`, `gp.load` -> `gp.Estimator.predict`

Neighbouring rows are nearly equal, so a random split rewards a look-up: every error names its split.
"""
