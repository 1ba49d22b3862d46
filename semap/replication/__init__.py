"""Changes of the database as they come out of its log.

`pgoutput` knows the bytes and does no I/O; `stream` is the one place that speaks to the socket.
"""
