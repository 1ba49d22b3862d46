"""What every room needs: connections, the tables, CQL2 as SQL, and the number of the newest event."""
