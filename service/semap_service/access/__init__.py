"""Who may call the service, for what, and how much of it."""
