"""Run time against error: the main job by every method, measured in one process."""
