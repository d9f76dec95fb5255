"""Diagnosis of recordings of four real machines: the results of `docs/real.md`."""
