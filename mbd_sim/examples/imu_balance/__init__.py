"""Example: an inverted pendulum is balanced on the measurements of an inertial sensor and an encoder."""
