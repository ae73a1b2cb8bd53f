"""The server of viser behind a gate: who may open the page, and how much it may send."""
