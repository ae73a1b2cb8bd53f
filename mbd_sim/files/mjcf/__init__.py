"""Reads and writes MJCF."""
