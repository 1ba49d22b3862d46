"""Relations between two intervals (Allen 1983), known as early as they can be."""
