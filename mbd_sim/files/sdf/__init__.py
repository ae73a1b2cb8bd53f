"""Reads and writes SDF."""
