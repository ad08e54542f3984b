"""Finds the order of a light field's views from the pictures."""
