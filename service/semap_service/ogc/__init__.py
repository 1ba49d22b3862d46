"""OGC API: maps for geographic information systems (Features, parts 1 to 3; Moving Features).

What is here reads requests and writes documents; `semap.store.features` finds the features.
"""
