"""Simulation of logs: protocols, scenarios and noise inputs."""
