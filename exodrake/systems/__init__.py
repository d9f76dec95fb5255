"""Parts: modules of equations as plain functions."""
