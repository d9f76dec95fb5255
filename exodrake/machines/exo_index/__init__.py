"""The Exo-Index, a tendon-driven index finger."""
