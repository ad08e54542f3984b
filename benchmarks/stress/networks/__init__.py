"""Stress cases of networks for single pictures."""
