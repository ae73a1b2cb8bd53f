"""Example: a pendulum on a cart is swung up by its energy and balanced by a linear-quadratic regulator."""
