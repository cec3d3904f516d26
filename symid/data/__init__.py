"""Measurements: recordings, units, checks and filters."""
