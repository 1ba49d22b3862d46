"""Foxglove: the map, who is on it and what happens, for its app: live, and as an MCAP file."""
