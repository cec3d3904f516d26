"""Friction of one joint at a time: samples, laws fitted to them, the choice of a law."""
