"""Logs, cases and their files."""
