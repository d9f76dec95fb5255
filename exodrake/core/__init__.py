"""What everything is made of: signals, parts, parameters, effects, machines, robots, units and errors."""
