"""Example: a six-axis arm follows a motion by computed-torque control."""
