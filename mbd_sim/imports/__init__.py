"""Mechanisms from the parts of CAD programs: STEP assemblies, and files of meshes."""
