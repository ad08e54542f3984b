"""Reads every input format: meshes as scenes, pictures and sets of views as light fields."""
