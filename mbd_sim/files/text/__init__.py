"""The text of mechanism files: YAML, units, values, parameters, functions; XML and meshes of robot descriptions."""
