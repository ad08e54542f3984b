"""Computational integral imaging reconstruction: the public Python interface."""
