"""Commands for files of mechanisms."""
