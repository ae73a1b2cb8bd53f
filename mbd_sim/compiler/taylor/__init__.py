"""The Taylor method: series of instruction lists, and its steps."""
