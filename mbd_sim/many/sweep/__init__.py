"""Runs with varied values."""
