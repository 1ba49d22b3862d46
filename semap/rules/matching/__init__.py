"""Row patterns: a frozen automaton, and the attempts that are under way in one key."""
