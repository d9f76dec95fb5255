"""Diagrams of the systems: the robot, its loops, MultibodyPlant variants, Meshcat; imported as `exodrake.diagrams`."""
