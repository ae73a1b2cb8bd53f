"""The thread that publishes, its messages and markers."""
