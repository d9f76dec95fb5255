"""Speed of simulation, estimator and diagnosis."""
