"""Parts of machines, a module of equations each; plugins add theirs."""

from exodrake.core import plugins

plugins.extend(__path__, "physics")
