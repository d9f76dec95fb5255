"""Requirements of the package and of the extras and groups named; the package itself has no hash to check."""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).parent.parent / "pyproject.toml"
OWN = re.compile(r"exodrake\[(.+)\]")  # extras of the package itself, as `all` names them


def requirements(*names: str) -> list[str]:
    """Those of the package itself, then of the extras and dependency groups named."""
    content = tomllib.loads(PROJECT.read_text())
    listed = content["project"]["optional-dependencies"] | content["dependency-groups"]

    def lines(name: str) -> list[str]:
        found = []
        for line in listed[name]:
            own = OWN.fullmatch(line)
            found += [one for extra in own[1].split(",") for one in lines(extra)] if own else [line]
        return found

    return content["project"]["dependencies"] + [line for name in names for line in lines(name)]


if __name__ == "__main__":
    print("\n".join(requirements(*(name for words in sys.argv[1:] for name in words.split(",")))))
