"""Simulation of one mechanism, or of many at once."""
