"""Gaps of shapes and cams, and forces at contacts."""
