"""Files that meshes and matrices are read from and written to."""
