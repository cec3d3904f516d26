"""What the robot does: exact expressions derived from its description."""
