"""The training loop: batches, updates, validation, checkpoints and logs."""
