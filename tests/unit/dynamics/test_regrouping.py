"""Groups of others in terms of ours, exactly; terms that groups may hold without naming them."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from sympy import Rational

from symid.dynamics.base_parameters import derive_base_parameters
from symid.dynamics.regrouping import (
    evaluate_regrouping,
    express_group,
    list_coupled_readings,
    list_kindred_readings,
    read_group,
)
from symid.errors import UsageError
from symid.robot.toml_reader import read_robot
from tests.chains import draw_parameters, regress
from tests.estimates import fill_robot
from tests.refusals import raises
from tests.regroupings import derive_regrouping

NAMES = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")


@pytest.fixture(scope="module")
def robot(robots_folder):
    return read_robot(robots_folder / "tx40.toml")


@pytest.fixture(scope="module")
def base(robot):
    return derive_base_parameters(robot)


def test_sums_are_read_in_either_notation(robot):
    expected = {(2, "ZZ"): Fraction(1), (0, "MZ"): Fraction(-7, 100), (6, "IA"): Fraction(2)}
    assert read_group("Izz3 - 0.07*mz1 + 2*Iam6", robot) == expected
    assert read_group("ZZ3 - 7/100*MZ1 + IAm6 + IAm6", robot) == expected
    assert read_group("-fs2", robot) == {(1, "Fc"): Fraction(-1)}
    assert read_group("fv1 \N{MINUS SIGN} 2*fs2", robot) == read_group("fv1 - 2*fs2", robot)
    assert read_group(".5 * my2 - 2e-1*fc2", robot) == {(1, "MY"): Fraction(1, 2), (1, "Fc"): Fraction(-1, 5)}


def test_our_own_groups_are_read_by_name(robot, base):
    for entry in (*base.parameters, *base.friction):
        assert read_group(entry.name, robot, base) == dict(entry.terms)
    assert read_group("2*ZZ1R - ZZR1", robot, base) == read_group("ZZR1", robot, base)
    with pytest.raises(UsageError, match=r"unknown .*'ZZR1'"):
        read_group("ZZR1", robot)


def test_couplings_with_any_name_are_read(robot):
    named = dataclasses.replace(robot, couplings=(dataclasses.replace(robot.couplings[0], name="wrist"),))
    assert read_group("Iawrist + fvwrist", named) == {(6, "IA"): 1, (6, "Fv"): 1}


@pytest.mark.parametrize(
    "text", ["", "Izz9", "Izz1 +", "Izz1 Izz2", "two", "0.5*", "1/0*Izz1", "Izz1 + exp(2)"]
)
def test_what_is_no_sum_of_parameters_is_refused(robot, text):
    with raises(UsageError, "usage.unreadable-group", match=r"group .*unknown"):
        read_group(text, robot)


@pytest.mark.parametrize("factor", ["9e999", "1e-13", "1" + "0" * 300])
def test_factors_out_of_all_reason_are_refused(robot, factor):
    with raises(UsageError, "usage.unreadable-group", match=f"{factor} of fv2.* 1e12"):
        read_group(f"fv1 - {factor}*fv2", robot)


def test_other_groups_of_the_same_space(base):
    """Twice the first and a sum of both say the same as the first two."""
    first, second = (
        {label: Fraction(int(value.p), int(value.q)) for label, value in entry.terms}
        for entry in base.parameters[:2]
    )
    both = {label: first.get(label, 0) + second.get(label, 0) for label in {**first, **second}}
    found = derive_regrouping(base, [{label: 2 * value for label, value in first.items()}, both])
    others = (0,) * 59
    assert found == [(Rational(2), 0, *others), (1, 1, *others)]


def test_a_group_that_nothing_shows_is_told_with_what_is_left(robot, base):
    found = []
    for text in ("Izz1", "Ixx2 - 1.0*Iyy2"):
        with pytest.raises(UsageError) as caught:
            express_group(base, read_group(text, robot, base), repr(text))
        found.append(caught.value.notices[0].text)
    express_group(base, read_group("fv1", robot, base), "fv1")
    first, second = found
    assert first.startswith("'Izz1' ")
    assert ": -IA1 - YY2" in first
    assert "when ZZR1 = ZZ1 + IA1 + YY2" in first
    assert second.startswith("'Ixx2 - 1.0*Iyy2' ")
    assert "0.050625*M3" in second


def test_a_parameter_of_another_friction_model_is_left_over(base):
    with pytest.raises(UsageError, match="Fvp1 is left"):
        express_group(base, {(0, "Fvp"): Fraction(1)}, "Fvp1")


def test_a_group_that_follows_from_others_says_from_which(robot, base):
    texts = ("ZZR1", "ZZR1 - fvm6", "fv1", "3*Fvm6")
    groups = [read_group(text, robot, base) for text in texts]
    with pytest.raises(UsageError, match=r"'3\*Fvm6' follows from 'ZZR1', 'ZZR1 - fvm6';"):
        derive_regrouping(base, groups, texts)
    with pytest.raises(UsageError, match="from nothing;"):
        derive_regrouping(base, [{(5, "Fv"): Fraction(0)}])


def test_the_matrix_as_numbers_gives_the_torques_of_standard_parameters(robot, base):
    """theirs = T ours for random bodies: both evaluated, and both give Pinocchio's torques."""
    filled = fill_robot(robot)
    rng = np.random.default_rng(3)
    standard = dict.fromkeys(regress(filled, *rng.uniform(-1, 1, (3, 6))), 0.0)
    for link, body in enumerate(draw_parameters(rng, 6)):
        standard |= {(link, name): float(x) for name, x in zip(NAMES, body, strict=True)}
    standard |= {label: float(rng.uniform(0.1, 1.0)) for label in standard if label[1] not in NAMES}
    ours = (*base.parameters, *base.friction)
    values = np.array([sum(float(c) * standard[label] for label, c in entry.terms) for entry in ours])
    # Neighbours added up, so that T is not the unit matrix.
    pairs = zip(ours, (*ours[1:], None), strict=True)
    groups = [dict(a.terms) if b is None else _add(dict(a.terms), dict(b.terms)) for a, b in pairs]
    change = evaluate_regrouping(derive_regrouping(base, groups), robot)
    direct = [sum(float(c) * standard[label] for label, c in group.items()) for group in groups]
    np.testing.assert_allclose(change @ values, direct, rtol=1e-12)
    for state in rng.uniform(-2, 2, (5, 3, 6)):
        columns = regress(filled, *state)
        torque = sum(column * standard[label] for label, column in columns.items())
        shown = np.column_stack([columns[entry.label] for entry in ours])
        np.testing.assert_allclose(shown @ np.linalg.solve(change, direct), torque, atol=1e-9)


def _add(first, second):
    return {label: first.get(label, 0) + second.get(label, 0) for label in (*first, *second)}


COUPLINGS = ({4: Fraction(1), 5: Fraction(1)}, {0: Fraction(-3, 2), 5: Fraction(2)})


@pytest.fixture(scope="module", params=COUPLINGS)
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
