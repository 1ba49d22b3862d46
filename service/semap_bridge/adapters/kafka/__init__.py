"""Kafka: states come from a topic, events and changes of relations go to topics, each exactly once.

Inward, the offset of each partition is committed with the states, in one transaction of the database.
Outward, a number that rises, the cursor, goes to a topic of its own in the same transaction of Kafka as the
events, and is read back with them. Who reads committed records (`isolation.level`) sees each event once.
"""
