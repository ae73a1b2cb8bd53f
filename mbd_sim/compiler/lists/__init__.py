"""Instruction lists: their order, what is alike in them, and their operations as IR."""
