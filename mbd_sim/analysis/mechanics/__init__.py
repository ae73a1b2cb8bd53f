"""Mobility, inverse dynamics, the sharing of loads, positions without masses."""
