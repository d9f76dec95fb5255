"""Studies with exodrake: programs that write documentation pages."""
