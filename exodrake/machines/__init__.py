"""Machines, a folder each: machine.py (`machine()`) or none, and robot.yaml."""

from exodrake.core import plugins

plugins.extend(__path__, "machines")
