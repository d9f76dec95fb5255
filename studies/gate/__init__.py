"""The gate of the next diagnosis: decision rules compared on the same fits, of simulated and real machines."""
