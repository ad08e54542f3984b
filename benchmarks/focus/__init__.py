"""Depth planes and disparity against exact depth."""
