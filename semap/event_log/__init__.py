"""The log of events for other tools: process mining, tables, a picture.

Each writer takes entries in the order of their stamps, one by one, and keeps none of them. No database.
"""
