"""Residuals: what a fit leaves, and what speaks against it."""
