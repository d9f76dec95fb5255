"""Machines, a folder each: machine.py (`machine()`) or none, robot.yaml, and recordings.py where recordings exist."""

from exodrake.core import plugins

plugins.extend(__path__, "machines")
