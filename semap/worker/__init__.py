"""Processes that follow the log and write what they make of it."""
