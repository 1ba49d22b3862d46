"""The rules of all maps at work: event time, keys, timers, events as rows of other rules."""
