"""What a worker process is not allowed to do, by limits, seccomp, Landlock and without capabilities."""
