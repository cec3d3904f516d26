"""Search a trajectory on which all parameters can be identified well, and follow it."""

import symid

robot = symid.load("two_link")
trajectory = robot.excite(harmonics=3, period=5.0, candidates=100, starts=2)
print(repr(trajectory))
run = robot.simulate(trajectory.save("excitation.csv", rate=500))
print(run.trajectory, run.tau.shape)
