"""Checks of a case before the search: what is refused, and what is suspicious."""

from exodrake.diagnosis.checks.refuse import check_case
from exodrake.diagnosis.checks.suspicions import suspicions

__all__ = ["check_case", "suspicions"]
