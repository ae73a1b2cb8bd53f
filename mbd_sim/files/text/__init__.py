"""The text of mechanism files: YAML, units, values, parameters, functions."""
