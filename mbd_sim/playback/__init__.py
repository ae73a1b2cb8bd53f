"""Recorded runs as tables, as plots, and in Rerun."""
