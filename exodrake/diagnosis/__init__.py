"""Where a sim-to-real gap lies, which unmodelled effect causes it, and how far it shrinks once that effect is added."""

from typing import Any


def __getattr__(name: str) -> Any:
    if name == "diagnose":
        from exodrake.diagnosis.pipeline import diagnose

        return diagnose
    if name == "Diagnosis":
        from exodrake.diagnosis.result import Diagnosis

        return Diagnosis
    raise AttributeError(name)
