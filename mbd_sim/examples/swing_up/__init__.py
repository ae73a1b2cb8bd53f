"""Example: a pendulum on a cart is swung up by energy control and balanced by a linear-quadratic regulator."""
