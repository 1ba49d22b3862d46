"""The map as it is now, for pages that draw it: a snapshot, then what changed since the last message.

It is state, not a log: a client that is slow skips what is overtaken already and gets the newest. Who needs
each event reads a feed of events.
"""
