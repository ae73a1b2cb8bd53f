"""One-sided elements during a run: the steps from event to event, complementarity, impacts and modes."""
