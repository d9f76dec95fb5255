"""Joint-angle estimator: a Gaussian process from tensions and strokes to joint angles with standard deviations.

    logs -> `dataset.sweeps_from_logs` -> `gp.fit` -> `gp.save`, `gp.load` -> `gp.Estimator.predict`

`gp.StrokeModel` finds the zeros of a session's strokes, which re-donning moves; `gp.Estimator.corrected` follows them.
`validate.validate` compares the process with a quadratic ridge and the nearest neighbour, on random rows and on whole
held-out sweeps. Every error names its split: neighbouring rows are nearly equal, so a random split rewards a look-up.
"""
