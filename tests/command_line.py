"""The command line in this process, as the tests call it."""

from click.testing import CliRunner, Result

from exodrake.cli.main import cli


def run(*arguments: object) -> Result:
    """A run of `exodrake` with arguments of any kind: exit code, output and error output."""
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])
