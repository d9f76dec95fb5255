"""Every package that may be installed is pinned by version and hash, and its licence is listed."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
PIN = re.compile(r"^([\w.-]+)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})*)$", re.MULTILINE)
ROW = re.compile(r"^\| ([\w.-]+) \| (\d\S*) \| (.+) \|$", re.MULTILINE)


def test_every_pin_has_a_hash_and_a_licence():
    pins = PIN.findall((ROOT / "constraints.txt").read_text())
    rows = ROW.findall((ROOT / "docs" / "licences.md").read_text())
    assert len(pins) > 50 and all(hashes for _, _, hashes in pins)
    listed = sorted((re.sub(r"[-_.]+", "-", name).lower(), number) for name, number, _ in rows)
    assert listed == [(name, number) for name, number, _ in pins]
    assert all(licence != "not stated" for _, _, licence in rows)


def test_what_installs_the_package_is_pinned_and_taken_as_pinned():
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    makefile = (ROOT / "Makefile").read_text()
    listing = [sys.executable, ROOT / ".ci" / "requirements.py", "--pinned", "build"]
    pins = PIN.findall(subprocess.run(listing, capture_output=True, text=True, check=True).stdout)
    assert [name for name, _, hashes in pins if hashes] == ["pip", *sorted(re.match(r"\w+", line)[0] for line in build)]
    assert "--require-hashes" in makefile
    for line in makefile.splitlines():
        assert "--editable" not in line or "--no-build-isolation" in line
