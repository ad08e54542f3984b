"""Measures `ciir batch`: speed by processes, workers that are killed, and how many workers a scheduler feeds."""
