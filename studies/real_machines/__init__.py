"""Four real machines, diagnosed: what `docs/real.md` says is measured here (`python -m studies.real_machines`)."""
