"""Files of meshes: where they are, and the solids that they enclose."""
