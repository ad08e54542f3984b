"""Numerical stress: what was bounded, the bound, and what was measured."""
