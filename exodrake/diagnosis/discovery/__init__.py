"""The missing law: what acts where in a robot that no known effect explains."""
