"""Discovery of a missing law: its point in the robot and its curve, where no known effect explains the gap."""
