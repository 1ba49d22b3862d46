"""The endpoints, one file for each resource; what two of them need is in a room below."""
