"""EMPS, an electro-mechanical positioning system."""
