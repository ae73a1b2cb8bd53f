"""Analyses of a mechanism at a state: mobility, integrability, small motions, inverse dynamics, and regulators."""
