"""Recordings of runs: the recorder, recomputation and verification."""
