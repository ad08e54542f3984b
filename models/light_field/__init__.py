"""Upscaling of a light field's views, each with the help of its neighbouring views."""
