"""Processes of semap beside one another, and a server of PostGIS for a while."""
