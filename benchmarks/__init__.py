"""Run time against error. Timings live here, never in tests."""
