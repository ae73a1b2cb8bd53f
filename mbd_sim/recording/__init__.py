"""Writing, reading, recovering, recomputing and verifying recordings."""
