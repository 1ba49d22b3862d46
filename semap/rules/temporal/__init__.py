"""Metric temporal logic over the state of relations, by progression."""
