"""Terms that groups may hold without naming them: what coupled drives leave open, by the torques."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.regrouping import list_coupled_readings, list_kindred_readings
from symid.robot.toml_reader import read_robot
from tests.chains import regress

COUPLINGS = ({4: Fraction(1), 5: Fraction(1)}, {0: Fraction(-3, 2), 5: Fraction(2)})


@pytest.fixture(
    scope="module", params=[{4: Fraction(1), 5: Fraction(1)}, {0: Fraction(-3, 2), 5: Fraction(2)}]
)
def case(request, robots_folder):
    """Return a robot whose motor turns with two joints, its base parameters and their own rows."""
    robot = read_robot(robots_folder / "tx40.toml")
    terms = tuple(request.param.items())
    robot = dataclasses.replace(robot, couplings=(dataclasses.replace(robot.couplings[0], terms=terms),))
    base = derive_base_parameters(robot)
    return robot, base, np.eye(base.count + len(base.friction), dtype=int).tolist(), dict(terms)


def test_a_drive_counted_to_its_joints_gives_the_same_torques(case):
    """The oracle: with the cross terms alone in the drive's column, the readings are the parameters."""
    robot, base, rows, terms = case
    ours = (*base.parameters, *base.friction)
    readings = list_coupled_readings(robot, base, rows)
    rng = np.random.default_rng(1)
    values = rng.uniform(0.5, 2.0, len(ours))
    theirs = values.copy()
    for entry in readings:
        theirs[entry.group] += float(entry.factor) * values[entry.column]
    assert np.sum(theirs != values) == 4
    for state in rng.uniform(-2, 2, (5, 3, 6)):
        columns = np.column_stack([regress(robot, *state)[entry.label] for entry in ours])
        crossed = columns.copy()
        for k, entry in enumerate(ours):
            if entry.label in {(6, "IA"), (6, "Fv")}:
                rates = state[2] if entry.label[1] == "IA" else state[1]
                for joint, factor in terms.items():
                    crossed[joint, k] -= float(factor) ** 2 * rates[joint]
        np.testing.assert_allclose(crossed @ theirs, columns @ values, atol=1e-10)


def test_what_names_the_drive_already_leaves_nothing_open(case):
    robot, base, rows, _ = case
    names = [entry.name for entry in (*base.parameters, *base.friction)]
    drives = [names.index("IAm6"), names.index("Fvm6")]
    named = [[*row] for row in rows]
    for row in named:
        for column in drives:
            row[column] = 1
    assert list_coupled_readings(robot, base, named) == ()
    without = [row for k, row in enumerate(rows) if k not in drives]
    assert list_coupled_readings(robot, base, without) == ()


def test_other_terms_are_of_the_kind_of_the_group(case):
    _, base, rows, _ = case
    names = [entry.name for entry in (*base.parameters, *base.friction)]
    found = list_kindred_readings(base, rows, [names.index("Fc2")])
    assert [(entry.name, entry.factor) for entry in found] == [
        (name, sign) for name in ("Fc1", "Fc3", "Fc4", "Fc5", "Fc6", "Fcm6") for sign in (1, -1)
    ]
    assert all(entry.coupling == "" for entry in found)
