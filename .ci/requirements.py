"""Requirements of the package and of the extras and groups named; the package itself has no hash to check."""

import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).parent.parent / "pyproject.toml"


def requirements(*names: str) -> list[str]:
    """Those of the package itself, then of the extras and dependency groups named."""
    content = tomllib.loads(PROJECT.read_text())
    listed = content["project"]["optional-dependencies"] | content["dependency-groups"]
    return content["project"]["dependencies"] + [line for name in names for line in listed[name]]


if __name__ == "__main__":
    print("\n".join(requirements(*(name for words in sys.argv[1:] for name in words.split(",")))))
