"""Features for geographic information systems: a map as collections that are filtered, sorted and paged."""
