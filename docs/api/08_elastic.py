"""Identify dynamics and springs with hysteresis of elastic joints by two methods."""

import symid

robot = symid.load("two_link_elastic")
logs = [robot.simulate(name, duration=4.0, seed=1).log for name in ("ta", "tb")]
for method in ("two-step", "nlp"):
    fit = robot.identify(logs, method=method)
    print(f"{method}: {fit['ZZR1']}; stiffness {fit.springs[0].elasticity.initial_stiffness:.0f} N m/rad")
print(fit.to_text())
