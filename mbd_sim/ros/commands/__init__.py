"""Commands of topics on their way to the simulation."""
