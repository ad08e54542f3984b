"""Measures run time against error. Timings live here, never in tests."""
