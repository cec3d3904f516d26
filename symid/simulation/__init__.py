"""The robot under control, with sensors like real ones."""
