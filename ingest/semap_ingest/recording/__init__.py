"""Recordings of robots, as values: the only place that reads what sensors said from files."""
