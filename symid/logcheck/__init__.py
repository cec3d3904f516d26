"""Logs looked at with the dynamics of the robot, before anything is identified."""
