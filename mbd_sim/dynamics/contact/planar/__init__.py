"""Contacts of planar bodies: what their shapes are in the plane of an outline, or of the mechanism."""
