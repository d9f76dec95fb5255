"""Commands, a module each; every module holds a click command named `command`. `exodrake.cli.main` lists them."""
