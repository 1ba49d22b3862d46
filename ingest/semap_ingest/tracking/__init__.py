"""Tracks in the image and on the map: associate, update or predict, delete, initiate.

Each tracker is one screen that calls a role of the textbook per file: `assignment` and `association`,
`kalman`, `initiation`, `deletion`, `footprint`, `amendment`. A tracker's state is its tracks, rows of
arrays, so that a step is a batch for all tracks at once. Trackers do no I/O, have no clock and draw
nothing at random: the same records in the same order give the same tracks with the same numbers.
"""
