"""Depth planes, pictures in focus everywhere, and disparity maps of a light field."""
