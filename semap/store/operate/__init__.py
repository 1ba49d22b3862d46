"""What operators care for: the schema, retention, maintenance, jobs, tokens, and how the database does."""
