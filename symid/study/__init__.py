"""Many identifications: Monte Carlo over noise, and what the papers' tables compare."""
