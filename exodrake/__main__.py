"""`python -m exodrake`."""

from exodrake.cli import main

main()
