"""Upscaling of one picture at a time, by a network or by interpolation."""
