"""Reference trajectories that make parameters visible."""
