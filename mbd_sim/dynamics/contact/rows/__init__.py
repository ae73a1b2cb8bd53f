"""Rows of slots, and rows that combine the wrenches on parts."""
