"""Persons from what a camera and a laser saw at one moment."""
