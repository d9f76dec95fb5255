"""Logs and cases: files, units, clock and checks."""
