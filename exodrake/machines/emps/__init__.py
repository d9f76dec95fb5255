"""Machine `emps`: table of parts and signals, and robot file."""
