"""Diagnosis of a sim-to-real gap: its location, the unmodelled effects that cause it, and its reduction by them."""
