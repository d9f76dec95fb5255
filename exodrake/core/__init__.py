"""What every machine is made of: signals, parts, parameters, effects, robots, units and errors."""
