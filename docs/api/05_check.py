"""Make a robot file from a URDF and a log, and look whether the log is good enough."""

import symid

constants = [0.11, 0.11, 0.062]  # N m/A of the motors
draft = symid.new_robot(urdf="arm.urdf", log="training.csv", rotors=True, torque_constant=constants)
robot = symid.load(draft.save("arm.toml"), friction="coulomb-viscous-offset")
found = robot.check("training.csv")
print(found)
print(found.accepted, len(found.notices))
