"""Programs that replace worker processes, or the work in them."""
