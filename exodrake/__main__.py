"""`python -m exodrake`."""

from exodrake.cli.main import main

main()
