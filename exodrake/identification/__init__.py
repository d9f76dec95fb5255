"""Identification from recordings: kinematics, workspace and joint stiffness."""
