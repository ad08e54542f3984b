"""Light fields: reading them from files, rendering them from meshes, their geometry, and writing them to files."""
