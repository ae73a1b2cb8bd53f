"""Recorded runs: their messages and files, and what is made of them."""
