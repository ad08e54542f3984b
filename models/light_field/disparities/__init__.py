"""The disparities of a view: whole pixels by which views are shifted, and the range of what is left."""
