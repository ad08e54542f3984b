"""The order of a light field's views, found from the pictures."""
