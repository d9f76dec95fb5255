"""Code generator: one compiled function for all parts and effects of a machine."""
