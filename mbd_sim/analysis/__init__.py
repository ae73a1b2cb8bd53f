"""What can be said of a mechanism before it moves: its mobility, its constraints, its small motions."""
