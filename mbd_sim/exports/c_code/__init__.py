"""A mechanism as C code."""
