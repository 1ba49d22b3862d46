"""Whole maps, out of the database and into it."""
