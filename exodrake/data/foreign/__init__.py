"""Foreign recordings as logs, by a mapping file."""
