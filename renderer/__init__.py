"""Light fields: read from files or rendered of a mesh, their geometry, and written to files."""
