"""Commands for runs and recordings."""
