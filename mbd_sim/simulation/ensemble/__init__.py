"""Many simulations of one mechanism at once."""
