"""Friction laws, and the helpers that they share."""
