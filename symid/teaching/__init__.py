"""Derivations told step by step."""
