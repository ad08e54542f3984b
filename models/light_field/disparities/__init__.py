"""The disparities of a view: whole pixels by which other views are shifted, and the range of what remains."""
