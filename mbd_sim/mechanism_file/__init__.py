"""Mechanism files: read, checked against the schema, and built into records."""
