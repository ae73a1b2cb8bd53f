"""Time stepping (Moreau 1988; Jean 1999): contacts act once in each step, and no event is located."""
