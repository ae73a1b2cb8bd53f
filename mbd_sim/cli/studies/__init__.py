"""Commands for studies of mechanisms."""
