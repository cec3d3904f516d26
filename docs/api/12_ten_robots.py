"""Identify ten robots of a series, whose forearms differ."""

from pathlib import Path

import symid

robot = symid.load("two_link")
for number in range(1, 11):
    Path("arm.toml").write_text(robot.path.read_text().replace("mass = 1.9", f"mass = 1.{number:02}"))
    run = symid.load("arm.toml", backend="python").simulate(duration=3.0, seed=number)
    print(number, robot.identify(run)["MX2"])
