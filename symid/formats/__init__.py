"""How robots are written: files in and out."""
