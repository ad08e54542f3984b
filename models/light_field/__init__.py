"""Upscaling of a light field's view with the help of the views around it."""
