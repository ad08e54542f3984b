"""Stress cases of single-picture networks."""
