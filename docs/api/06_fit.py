"""Identify a robot by weighted least squares."""

import symid

robot = symid.load("two_link")
fit = robot.identify(robot.simulate(seed=1).log, estimator="wls")
print(fit)
print(fit["ZZ2"], fit.covariance.shape)
