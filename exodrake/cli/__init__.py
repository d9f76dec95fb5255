"""Commands, a module for each group; `exodrake.cli.main` lists them."""
