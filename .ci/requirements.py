"""Requirements of the package and of the extras and groups named; the package itself has no hash to check.

With `--pinned` those of the groups alone, as constraints.txt has them, version and hashes: for a pip of any age.
"""

import re
import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).parent.parent / "pyproject.toml"
PINS = PROJECT.with_name("constraints.txt")
OWN = re.compile(r"exodrake\[(.+)\]")  # extras of the package itself, as `all` names them


def requirements(*names: str, own: bool = True) -> list[str]:
    """Those of the package itself, if its own are wanted, then of the extras and dependency groups named."""
    content = tomllib.loads(PROJECT.read_text())
    listed = content["project"]["optional-dependencies"] | content["dependency-groups"]

    def lines(name: str) -> list[str]:
        found = []
        for line in listed[name]:
            itself = OWN.fullmatch(line)
            found += [one for extra in itself[1].split(",") for one in lines(extra)] if itself else [line]
        return found

    return content["project"]["dependencies"] * own + [line for name in names for line in lines(name)]


def pinned(*names: str) -> list[str]:
    """Version and hashes of what the groups named require."""
    wanted = {re.split(r"[^\w.-]", line)[0] for line in requirements(*names, own=False)}
    pins = re.findall(r"^\w\S*==.*(?:\n +--hash=.*)*", PINS.read_text(), re.MULTILINE)
    return [pin for pin in pins if pin.partition("==")[0] in wanted]


if __name__ == "__main__":
    listed = pinned if sys.argv[1] == "--pinned" else requirements
    print("\n".join(listed(*(word for word in sys.argv[1:] if word != "--pinned"))))
