"""A mechanism in motion: one, or many at once."""
