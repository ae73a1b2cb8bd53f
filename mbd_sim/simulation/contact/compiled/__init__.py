"""What happens at contacts, in functions that are compiled once for all mechanisms."""
