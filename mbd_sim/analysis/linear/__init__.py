"""Small motions about a state: linear systems, modes, regulators."""
