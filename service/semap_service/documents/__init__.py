"""What bodies look like: documents of JSON as pydantic models, and the description of the feeds."""
