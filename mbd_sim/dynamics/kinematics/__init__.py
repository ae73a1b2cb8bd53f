"""Motions of joints, links and bodies, and the symbols that describe them."""
