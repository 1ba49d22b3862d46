"""Bridges: what robots, brokers and buildings say becomes states, and what happens is told to them."""
