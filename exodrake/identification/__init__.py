"""Identification from recordings: kinematics, workspace, joint stiffness, maximum tensions, fits of parameters.

The methods, with the equations of the paper that they correct: `docs/explain/identification.md`.
"""
