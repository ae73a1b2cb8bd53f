"""Poses and rotations as numbers."""
