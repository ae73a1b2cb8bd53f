"""Reads and writes URDF."""
