"""Example: a six-axis arm with servos follows a trajectory for its joints."""
