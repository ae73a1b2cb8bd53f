"""Integration methods as data."""
