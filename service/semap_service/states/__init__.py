"""States that clients send."""
