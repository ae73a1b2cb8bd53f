"""Exact polynomials and numbers from which formulas are made."""
