"""Builds the records of a mechanism from a checked file."""
