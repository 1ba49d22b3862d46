"""The operations of the service, each a plan: what is asked in which order, and what comes of it."""
