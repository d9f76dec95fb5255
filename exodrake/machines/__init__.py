"""Built-in machines, a folder each, and robot files."""
