"""Write the identified robot as a URDF, and as a C header."""

import symid

robot = symid.load("two_link")
fit = robot.identify(robot.simulate(seed=1).log, estimator="wls")
for path in ("identified.urdf", "identified.h"):
    print(fit.export(path))
