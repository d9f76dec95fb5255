"""The next experiment: a motion, safe on every explanation still in play, by which they differ most."""
