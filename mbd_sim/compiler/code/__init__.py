"""IR to machine code in memory."""
