"""Commands that make pictures of light fields, meshes and pictures."""
