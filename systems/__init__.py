"""Parts of a robot as Drake systems, a LeafSystem a file; imported as `exodrake.systems`."""
