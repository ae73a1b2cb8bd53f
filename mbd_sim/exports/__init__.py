"""Mechanisms for other programs."""
