"""Inspection: finds out what an input is before it is processed."""
