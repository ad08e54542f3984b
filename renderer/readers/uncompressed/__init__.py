"""Decodes picture formats that store pixels without compression."""
