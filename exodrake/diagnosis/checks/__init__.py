"""Checks of a case before its diagnosis: requirements, suspicions, and what it could tell (`exodrake check`)."""
