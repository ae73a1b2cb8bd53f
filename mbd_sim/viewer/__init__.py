"""The scene in Rerun."""
