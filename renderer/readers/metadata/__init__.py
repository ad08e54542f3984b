"""Reads the metadata of picture files."""
