"""Measures `ciir batch`: speed by processes, workers that are killed, and memory."""
