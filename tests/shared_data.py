"""Data that the checkout does not hold: logs of the reference model, recordings of real machines, practice cases."""

import os
from functools import cache
from pathlib import Path

import pytest

# a part by which a folder is recognised
KNOWN_BY = {"reference": "sweeps.csv", "real": "emps", "practice": "labels.json"}


@cache
def data_folder(name: str) -> Path | None:
    """The folder data/NAME: in EXODRAKE_DATA, or in `data` or `shared/data` beside or above the checkout."""
    bases = [Path(os.environ["EXODRAKE_DATA"])] if "EXODRAKE_DATA" in os.environ else []
    for parent in Path(__file__).resolve().parents:
        bases += [parent / "data", parent / "shared" / "data"]
    return next((base / name for base in bases if (base / name / KNOWN_BY[name]).exists()), None)


def needs_data(name: str) -> pytest.MarkDecorator:
    """Skips a test where the folder is absent, and says which."""
    reason = f"data/{name} with {KNOWN_BY[name]} is absent: neither in EXODRAKE_DATA nor beside or above the checkout"
    return pytest.mark.skipif(data_folder(name) is None, reason=reason)
