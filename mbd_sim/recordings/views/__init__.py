"""Recorded runs as tables, plots and scenes."""
