"""Recordings in columns of other people, read by a mapping file."""
