"""semap: a semantic map with continuous queries, on PostGIS."""

__version__ = "0.1.0"
