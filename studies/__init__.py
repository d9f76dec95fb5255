"""Studies outside the package: the paper reproduced and questioned, and real machines."""
