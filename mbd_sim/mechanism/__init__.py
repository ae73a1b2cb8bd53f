"""A mechanism as plain records, which all other packages read."""
