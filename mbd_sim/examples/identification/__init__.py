"""Example: parameters of a mechanism are identified from a recording."""
