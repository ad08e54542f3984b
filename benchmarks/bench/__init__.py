"""Run time against error: the main job by every method, side by side in one process run."""
