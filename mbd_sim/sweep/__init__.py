"""Many runs of one mechanism with other values: planned, computed here or by Dask, kept as tables, drawn."""
