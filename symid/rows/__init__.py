"""Rows: how measurements become equations that are linear in the parameters, and what these can tell."""
