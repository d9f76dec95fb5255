"""Grasp planning: from a mode and the size of an object to tensions.

Plane of the finger: origin in the MCP, x along the proximal phalanx at MCP zero, y palmar, as complex x + iy [m].
"""
