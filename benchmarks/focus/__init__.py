"""Compares depth planes and disparity with exact depth."""
