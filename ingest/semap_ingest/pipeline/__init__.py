"""The roles of perception put together: records in, tracks and lines out, and how they reach the database."""
