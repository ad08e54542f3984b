"""Readers for files that hold a whole light field."""
