"""The database: connections, its schema, and the statements that Python sends to it."""
