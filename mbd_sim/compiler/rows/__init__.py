"""Active rows of a linear system: their factors, values of slots, and forces that rows share."""
