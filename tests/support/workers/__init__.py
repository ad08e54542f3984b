"""Programs that take the place of worker processes, or of the work in them."""
