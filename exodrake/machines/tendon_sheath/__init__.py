"""Bending joint of a flexible endoscope."""
