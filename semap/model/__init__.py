"""Values of the domain. They do no I/O and know nothing of the database."""
