"""Machine `exo_index`: table of parts and signals, and robot file."""
