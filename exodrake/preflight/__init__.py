"""What a case is good for, before it is diagnosed: `exodrake check`."""
