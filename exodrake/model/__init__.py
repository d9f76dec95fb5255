"""What a machine is made of: parts, signals, effects, robots and their units."""
