"""Parameter sweeps: many runs of one mechanism with varied values, computed with Dask, as tables and plots."""
