"""The sections of a mechanism file, their keys and units."""
