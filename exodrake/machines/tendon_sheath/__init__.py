"""Machine `tendon_sheath`: table of parts and signals, and robot file."""
