"""Rows of constraints, the closing of loops, and the start that satisfies them."""
