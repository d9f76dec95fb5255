"""Machines, a folder each: machine.py (`machine()`), robot.yaml, and recordings.py where recordings exist."""

from exodrake.core import plugins

plugins.extend(__path__, "machines")
