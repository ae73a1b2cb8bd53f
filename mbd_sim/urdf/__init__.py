"""URDF read as a mechanism, and a mechanism written as URDF."""
