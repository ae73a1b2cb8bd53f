"""Poses and rotations as numerical arrays."""
