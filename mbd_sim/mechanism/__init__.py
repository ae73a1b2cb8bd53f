"""A mechanism as plain records."""
