"""Detectors, a module each: `detect(problem)` returns the problem with what its logs show before any fit."""
