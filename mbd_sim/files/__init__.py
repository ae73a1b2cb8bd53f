"""Mechanism files and robot descriptions: read, checked and written."""
