"""A mechanism as plain records, which everything else reads."""
