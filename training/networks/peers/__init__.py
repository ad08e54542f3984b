"""Networks from the literature, for comparison."""
