"""Mechanisms as pictures, animations and scenes in Rerun."""
