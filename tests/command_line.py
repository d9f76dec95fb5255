"""The command line as the tests call it: in this process, or many commands in one process of their own."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

from click.testing import CliRunner, Result

from exodrake.cli.main import cli

ROOT = Path(__file__).parent.parent
FOLLOW = """
import json, shlex, sys
from click.testing import CliRunner
from exodrake.cli.main import cli
space, said = {}, []
for kind, text in json.loads(sys.stdin.read()):
    if kind == "python":
        exec(compile(text, "<block>", "exec"), space)
        continue
    result = CliRunner().invoke(cli, shlex.split(text)[1:])
    broken = repr(result.exception) if result.exception and result.exc_info[0] is not SystemExit else ""
    said.append([text, result.exit_code, result.stdout, result.stderr, broken])
print("RESULTS" + json.dumps(said))
"""


def run(*arguments: object) -> Result:
    """A run of `exodrake` with arguments of any kind: exit code, output and error output."""
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def follow(steps: list[tuple[str, str]], folder: Path) -> dict[str, SimpleNamespace]:
    """Follows steps of a page, ("python", block) or ("command", "exodrake ..."), in one new process: line -> result."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))}
    options = {"capture_output": True, "text": True, "cwd": folder, "env": environment}
    process = subprocess.run([sys.executable, "-c", FOLLOW], input=json.dumps(steps), **options)
    assert process.returncode == 0, process.stderr
    names, found = ("exit_code", "stdout", "stderr", "broken"), json.loads(process.stdout.partition("RESULTS")[2])
    return {line: SimpleNamespace(**dict(zip(names, rest, strict=True))) for line, *rest in found}
