"""Continuous queries, their conditions, and the relations that they keep."""
