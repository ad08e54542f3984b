"""Stress cases of geometry: pixel mapping and both rendering backends."""
