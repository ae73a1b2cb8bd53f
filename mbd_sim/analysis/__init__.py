"""What is computed from a model on request."""
