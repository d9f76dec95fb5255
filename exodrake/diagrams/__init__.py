"""Drake systems: a LeafSystem per part, the Diagram, and its display in Meshcat."""
