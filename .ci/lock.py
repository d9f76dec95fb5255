"""`make lock`: constraints.txt with the hashes of each package's files, and docs/licences.md, by asking pip.

Versions stay as constraints.txt has them; a line without hashes, or no line, takes what pip chooses. pip refuses a file
whose hash is not listed. Listed are the files for the systems that Drake is built for.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from requirements import requirements

ROOT = Path(__file__).parent.parent
PYTHONS = ("3.12", "3.13", "3.14")
SYSTEMS = (
    [f"manylinux_2_{n}_x86_64" for n in (34, 31, 28, 27, 26, 24, 17)] + ["manylinux2014_x86_64"],
    [f"macosx_{n}_{arch}" for n in ("26_0", "15_0", "14_0", "13_0", "12_0", "11_0") for arch in ("arm64", "universal2")]
    + [f"macosx_10_{n}_universal2" for n in (15, 14, 13, 12, 11, 10, 9)],
)
HEADING = """\
# Versions that the tests pass with, and the SHA-256 of their files; made by `make lock`.
# pip takes them as limits, not as a list of what to install.
"""
STATED = {"ezc3d": "MIT (its LICENSE file)"}  # by packages whose metadata say nothing
PAGE = """\
# Licences

exodrake is under [BSD-3-Clause](https://opensource.org/license/bsd-3-clause). It installs and does not contain these
packages, whose licences are as their metadata state them; those in the second table serve its tests, documentation and
benchmarks alone. Made by `make lock`.

It contains [uPlot](https://github.com/leeoniya/uPlot) 1.6.32, which draws the curves of its reports, under the MIT
licence (`exodrake/report/templates/uplot/LICENSE`).
"""


def chosen(requirements: list[str], pins: Path, target: list[str]) -> list[dict]:
    """What pip would install: its metadata, and where from. Nothing is installed."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-"]
    command += ["--disable-pip-version-check", "-c", str(pins), *target, *requirements]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["install"]


def name_of(package: dict) -> str:
    """The normalised name."""
    return re.sub(r"[-_.]+", "-", package["metadata"]["name"]).lower()


def licence_of(metadata: dict) -> str:
    """The licence in as few words as the metadata allow."""
    if metadata["name"] in STATED:
        return STATED[metadata["name"]]
    classifiers = [c.rpartition(" :: ")[2] for c in metadata.get("classifier", []) if c.startswith("License ::")]
    text = metadata.get("license_expression") or ", ".join(c for c in classifiers if c != "OSI Approved")
    return (text or metadata.get("license", "").strip().partition("\n")[0] or "not stated")[:80]


def main() -> None:
    """Write both files."""
    used = requirements("all")
    developed = requirements("docs", "dev", "bench", "build")
    with tempfile.TemporaryDirectory() as folder:
        pins, known = Path(folder) / "pins.txt", (ROOT / "constraints.txt").read_text()
        pins.write_text("\n".join(re.findall(r"^\w\S*==\S+", known, re.MULTILINE)))
        packages = {name_of(p): p for p in chosen(used + developed, pins, [])}
        of_users = {name_of(p) for p in chosen(used, pins, [])}
        pins.write_text("\n".join(f"{name}=={p['metadata']['version']}" for name, p in packages.items()))
        hashes: dict[str, set[str]] = {name: set() for name in packages}
        for python in PYTHONS:
            for system in SYSTEMS:
                target = ["--only-binary", ":all:", "--python-version", python, "--target", folder]
                for p in chosen(used + developed, pins, target + [w for tag in system for w in ("--platform", tag)]):
                    hashes[name_of(p)].add(p["download_info"]["archive_info"]["hashes"]["sha256"])
    lines = []
    for name, package in sorted(packages.items()):
        listed = "".join(f" \\\n    --hash=sha256:{digest}" for digest in sorted(hashes[name]))
        lines.append(f"{name}=={package['metadata']['version']}{listed}\n")
    (ROOT / "constraints.txt").write_text(HEADING + "".join(lines))
    page = PAGE
    for title, names in (("Packages of users", of_users), ("Packages of developers", packages.keys() - of_users)):
        page += f"\n## {title}\n\n| package | version | licence |\n|---|---|---|\n"
        for metadata in (packages[name]["metadata"] for name in sorted(names)):
            page += f"| {metadata['name']} | {metadata['version']} | {licence_of(metadata)} |\n"
    (ROOT / "docs" / "licences.md").write_text(page)


if __name__ == "__main__":
    main()
