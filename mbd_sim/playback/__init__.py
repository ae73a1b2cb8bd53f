"""Recorded runs looked at: as tables, as pictures, and in Rerun."""
