"""Live use: a log that still grows, the simulated twin in step with it, the gap of each block, and an alarm."""
