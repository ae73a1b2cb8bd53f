"""The node that publishes recordings again."""
