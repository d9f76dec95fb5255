"""SO-101, an arm of six position servos."""
