"""Checks of a case before the search: errors that refuse it, and suspicions that are noted."""

from exodrake.diagnosis.checks.refuse import check_case, without_short_logs
from exodrake.diagnosis.checks.suspicions import suspicions, suspicions_of

__all__ = ["check_case", "suspicions", "suspicions_of", "without_short_logs"]
