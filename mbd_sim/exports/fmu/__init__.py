"""A mechanism as a Functional Mock-up Unit."""
