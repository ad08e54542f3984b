"""Depth planes, pictures that are in focus everywhere, and disparity maps of a light field."""
