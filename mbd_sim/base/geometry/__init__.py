"""Poses and rotations, also of many variants at once."""
