"""The feeds: every event once, in order, to whoever follows, however fast they read.

`ring` follows the database for the whole process. A subscription begins where `start_position` says, takes
batches from the `channel` of its selection and puts them into its outlet, a WebSocket or an event stream, at
the client's own pace (`subscription`). What clients are sent is in `documents.feed`.
"""
