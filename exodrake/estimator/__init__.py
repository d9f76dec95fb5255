"""The joint-angle estimator: a Gaussian process from tensions and strokes to joint angles, and how far to trust it.

    logs -> `dataset.sweeps_from_logs` -> `gp.fit` -> `file.save`, `file.load` -> `gp.Estimator.predict`
    `validate.validate` judges it, with the quadratic `ridge` and the nearest neighbour, on random rows and on whole
    held-out sweeps

Every figure names its split: neighbours in time are nearly equal, so a random split rewards looking the answer up.
"""
