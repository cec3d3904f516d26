"""Predict the torques of another motion, and draw them next to those measured."""

import symid

robot = symid.load("two_link")
fit = robot.identify(robot.simulate(seed=1).log, estimator="wls")
validation = fit.validate(robot.simulate("tc", seed=2).log, gate=5.0)
print(validation)
print(validation.accepted, validation.plot().save("torques.svg"))
