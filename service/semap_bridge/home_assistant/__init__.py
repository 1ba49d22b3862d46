"""A map as Home Assistant sees it: rooms, people, doors and rules, without any connection."""
