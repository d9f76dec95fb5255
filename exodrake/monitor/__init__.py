"""Monitor of a growing log: the model beside the robot, the gap of each segment, and an alarm."""
