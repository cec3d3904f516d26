"""Groups of others in terms of ours, exactly."""

from fractions import Fraction

import pytest
from sympy import Rational

from symid.errors import UsageError
from symid.formats.toml import read_robot
from symid.parameters.base import find_base_parameters
from symid.parameters.regrouping import find_regrouping, read_group


@pytest.fixture(scope="module")
def robot(robots_folder):
    return read_robot(robots_folder / "tx40.toml")


@pytest.fixture(scope="module")
def base(robot):
    return find_base_parameters(robot)


def test_sums_are_read_in_either_notation(robot):
    expected = {(2, "ZZ"): Fraction(1), (0, "MZ"): Fraction(-7, 100), (6, "IA"): Fraction(2)}
    assert read_group("Izz3 - 0.07*mz1 + 2*Iam6", robot) == expected
    assert read_group("ZZ3 - 7/100*MZ1 + IAm6 + IAm6", robot) == expected
    assert read_group("-fs2", robot) == {(1, "Fc"): Fraction(-1)}


@pytest.mark.parametrize("text", ["Izz9", "Izz1 +", "Izz1 Izz2", "two", "0.5*", "Izz1 + exp(2)"])
def test_what_is_no_sum_of_parameters_is_refused(robot, text):
    with pytest.raises(UsageError, match="is no parameter of this robot") as caught:
        read_group(text, robot)
    assert caught.value.notices[0].code == "usage.unreadable-group"


def test_our_own_groups_are_the_unit_matrix(base):
    ours = (*base.parameters, *base.friction)
    groups = [{label: Fraction(int(value.p), int(value.q)) for label, value in entry.terms} for entry in ours]
    found = find_regrouping(base, groups)
    assert found.is_complete
    assert found.absent == ()
    assert all(
        value == (1 if k == column else 0)
        for k, row in enumerate(found.rows)
        for column, value in enumerate(row)
    )


def test_other_groups_of_the_same_space(base):
    """Twice the first and a sum of both say the same as the first two."""
    first, second = (
        {label: Fraction(int(value.p), int(value.q)) for label, value in entry.terms}
        for entry in base.parameters[:2]
    )
    both = {label: first.get(label, 0) + second.get(label, 0) for label in {**first, **second}}
    found = find_regrouping(base, [{label: 2 * value for label, value in first.items()}, both])
    assert [row[:2] for row in found.rows] == [(Rational(2), 0), (1, 1)]
    assert len(found.absent) == 59
    assert found.is_complete


def test_a_group_that_nothing_shows_is_refused(base):
    with pytest.raises(
        UsageError, match="group 1 holds a combination of parameters that no motion"
    ) as caught:
        find_regrouping(base, [{(0, "M"): Fraction(1)}])
    assert caught.value.notices[0].code == "usage.other-groups"


def test_groups_that_repeat_each_other_are_refused(base):
    group = {(5, "Fv"): Fraction(1)}
    with pytest.raises(UsageError, match="the 2 groups are not independent"):
        find_regrouping(base, [group, group])
