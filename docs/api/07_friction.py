"""Find the friction of one joint, by a law that is asked for; `model="auto"` compares all laws."""

import symid

robot = symid.load("two_link")
fit = robot.identify_friction(robot.simulate(seed=1).log, model="coulomb-viscous-offset")
print(fit.joints["elbow"].formula)
print(fit["elbow.fC"])
