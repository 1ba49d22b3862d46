"""Rules: what they declare, and the state machine that turns changes into events.

No I/O and no clock. The state is a value and is passed in; a worker persists it together with the
events that it made and its place in the log.
"""
