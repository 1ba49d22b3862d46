"""Rules apart from the database: `semap publish` sends what they take, `semap collect` writes what they made.

PREFIX.due has the steps of all maps as records, PREFIX.events what rules made of them, both by map.
Each is there at least once; who reads passes over what it had before, so that each event is written once.
"""
