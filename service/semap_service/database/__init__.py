"""The database as one caller may see and change it: roles, transactions, the events of their choice."""
