"""Machine `so101`: table of parts and signals, and robot file."""
