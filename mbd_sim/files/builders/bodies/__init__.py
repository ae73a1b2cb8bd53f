"""Builds parts from their records in the file: points, mass properties, shapes, and what of these touches."""
