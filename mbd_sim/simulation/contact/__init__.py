"""Contacts during a run: complementarity, impacts, modes and events."""
