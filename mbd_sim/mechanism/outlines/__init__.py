"""Outlines of planar bodies: chains of lines, arcs and involutes."""
