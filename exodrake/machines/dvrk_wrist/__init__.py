"""Machine `dvrk_wrist`: table of parts and signals, and robot file."""
