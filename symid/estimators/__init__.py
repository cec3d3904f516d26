"""Estimators: how equations become parameters, with their deviations."""
