"""Restrictions of a worker process, by limits, seccomp, Landlock and the removal of capabilities."""
