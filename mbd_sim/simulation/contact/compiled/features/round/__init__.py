"""The narrow phase of two convex bodies of which at least one is round, in the subset of Python that is compiled."""
