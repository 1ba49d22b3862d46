"""Sensors and recordings in, states of tracks into the database."""
