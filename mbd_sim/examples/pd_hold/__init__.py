"""Example: a PD controller with gravity compensation holds a double pendulum in place."""
