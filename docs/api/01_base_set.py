"""Load a URDF and print its base parameters."""

import symid

robot = symid.load("arm.urdf")
print(robot.base)
