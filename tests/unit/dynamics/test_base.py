"""Base sets by form, null space, standard parameters, names and reasons of all parameters."""

import re
from dataclasses import replace
from fractions import Fraction

import pytest
from sympy import Rational, Symbol, sqrt

from symid.dynamics.base_parameters import BASE_FORMS, build_standard_parameters, derive_base_parameters
from symid.dynamics.explanations import get_label_unit, write_label, write_number
from symid.errors import RobotError
from symid.joint_models import FrictionValues
from symid.robot.description import Coupling, Spring
from tests.chains import PANDA, PI, PUMA560, TWO_LINK, build_chain, change_joints, each_robot, follow
from tests.refusals import raises

KNOWN = {TWO_LINK: (6, 6, 4, 4), PUMA560: (36, 36, 34, 10), PANDA: (43, 43, 39, 12)}


def derive_reasons(robot, **options):
    """Return why parameters were left out, by name."""
    return {entry.name: entry.reason for entry in derive_base_parameters(robot, **options).eliminated}


@pytest.mark.parametrize(("robot", "counts"), KNOWN.items(), ids=lambda value: getattr(value, "name", ""))
def test_counts_by_form(robot, counts):
    assert tuple(derive_base_parameters(robot, form=form).count for form in BASE_FORMS) == counts


@each_robot(*KNOWN)
def test_the_null_space_is_all_that_the_grouping_loses(robot):
    base = derive_base_parameters(robot)
    assert len(base.null_space) == len(base.labels) - base.count
    for change in base.null_space:
        moved = dict(change)
        for parameter in base.parameters:
            assert sum(value * moved.get(label, 0) for label, value in parameter.terms) == 0


def test_standard_parameters_stand_for_themselves():
    base = build_standard_parameters(build_chain([(0.0, 0, 0, "q")] * 2, rotors=True))
    assert base.vector == "pi"
    assert [parameter.name for parameter in base.parameters][9:12] == ["M1", "IA1", "XX2"]
    assert base.count == 22


def couple(robot, *terms, name="m", **fields):
    """Return the robot with a drive that turns with two joints."""
    pairs = tuple((index, Fraction(factor)) for index, factor in terms)
    return replace(robot, couplings=(Coupling(name=name, terms=pairs, **fields),))


ELBOW = [(0.0, 0, 0, "q"), (PI / 2, 0, 0, "q")]


def test_a_coupled_drive_has_parameters_of_its_own_name():
    friction = FrictionValues(law="coulomb-viscous")
    arm = build_chain(ELBOW, rotors=True)
    base = derive_base_parameters(couple(arm, (0, 1), (1, 1), name="m2", has_rotor=True, friction=friction))
    reasons = {parameter.name: parameter.reason for parameter in (*base.parameters, *base.friction)}
    assert reasons["IAm2"] == reasons["Fvm2"] == "identifiable on its own: its drive turns with joints 1, 2"


def test_the_friction_of_a_follower_adds_to_its_masters():
    robot = follow(build_chain(ELBOW, friction="coulomb-viscous"), 1, 0, "-2")
    # Fv acts through the ratio twice, Fc once, whatever its sign.
    friction = derive_base_parameters(robot).friction
    assert [entry.expression for entry in friction] == ["Fv1 + 4*Fv2", "Fc1 + 2*Fc2"]
    reasons = derive_reasons(robot)
    assert reasons["Fv2"].startswith("grouped into FvR1: ")
    assert any("moves only with the joint that it follows" in reason for reason in reasons.values())


def test_springs_show_and_their_preload_joins_an_offset():
    chain = build_chain([(0.0, 0, 0, "q")], friction="coulomb-viscous-offset")
    sprung = change_joints(chain, spring=Spring())
    names = {parameter.name: parameter for parameter in derive_base_parameters(sprung).parameters}
    assert names["KS1"].reason == "identifiable on its own"
    preload = names["KRR1"]
    assert preload.expression == "KR1 + offset1"
    assert preload.reason == "offset1: a constant torque, like that of an offset or of a preload"
    reasons = derive_reasons(sprung, form="momentum")
    assert reasons["KS1"] == "no effect on the momentum: spring of joint 1"


def test_units_and_reasons_of_a_drive_that_turns_and_slides():
    rows = [(0.0, 0, 0, "q"), (PI / 3, 0, "q", 0.0)]
    arm = build_chain(rows, rotors=True)
    mixed, sliding = (couple(arm, *terms, has_rotor=True) for terms in (((1, 1), (0, 1)), ((1, 1),)))
    assert get_label_unit(mixed, (2, "IA")) == "kg m^2", "whatever the order of its joints"
    assert get_label_unit(sliding, (2, "IA")) == "kg"


def test_what_would_not_end_is_refused():
    robot = build_chain([(PI / 6, 0, 0, "q"), (-PI / 2, 0.1, 0, "q"), (-PI / 2, "A2", 0, "q")])
    alone = follow(robot, 2, 1)
    with raises(RobotError, "robot.too-symbolic", match=r"\(A2\).* joint1, joint2, joint3:"):
        derive_base_parameters(follow(alone, 0, 1))
    assert derive_base_parameters(alone).count > 0, "two joints on one coordinate are no trouble"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Rational(1), "1"),
        (Rational(-3), "-3"),
        (Rational(2159, 5000), "0.4318"),
        (Rational(-1, 8), "-0.125"),
        (Rational(1, 3), "1/3"),
        (Symbol("L1") ** 2, "L1^2"),
        (Symbol("L1") + Symbol("L2"), "(L1 + L2)"),
        (sqrt(3) / 2, "sqrt(3)/2"),
        (Rational(10**25 + 1, 3 * 10**25), "~0.333333333333333"),
    ],
)
def test_numbers(value, text):
    assert write_number(value) == text


def test_every_parameter_has_a_reason():
    base = derive_base_parameters(PANDA)
    accounted = {p.label for p in base.parameters} | {e.label for e in base.eliminated}
    assert accounted == set(base.labels)
    first = derive_base_parameters(TWO_LINK).parameters[0]
    assert (first.name, first.expression) == ("ZZR1", "ZZ1 + 0.25*M2")
    assert first.reason == "M2: mass on the axis of a revolute joint moves with the link before"


SLIDES = build_chain([(0.0, 0, "q", 0.0), (PI / 2, 0, "q", 0.0), (0.0, 0, 0, "q")])
OFFSETS = build_chain([(0.0, 0, 0, "q")] * 2, friction="coulomb-viscous-offset")
OFFSET = FrictionValues(law="coulomb-viscous-offset")
STILL = couple(follow(build_chain(ELBOW), 1, 0), (0, 1), (1, 1), has_rotor=True)
STEPS = follow(build_chain(ELBOW, friction="asymmetric"), 1, 0, "-1/2")


@pytest.mark.parametrize(
    ("robot", "form", "name", "reason"),
    [
        (PANDA, "torque", "M7", "grouped into XXR2, ZZR2, MYR2.*moves with the link before$"),
        (PANDA, "torque", "XX1", "no effect on joint torques: link 1 turns about its z axis only$"),
        (PANDA, "torque", "YY4", ".*only XX - YY does$"),
        (SLIDES, "torque", "ZZ1", ".*link 1 never turns"),
        (TWO_LINK, "gravity", "ZZ2", "no effect on torques at rest: link 2 turns about its z axis only$"),
        (TWO_LINK, "momentum", "MX1", "no effect on the momentum:"),
        (
            couple(OFFSETS, (0, 1), (1, 1), friction=OFFSET),
            "torque",
            "offsetm",
            "grouped into offsetR1, offsetR2: a constant torque",
        ),
        (STILL, "torque", "IAm", "no effect on joint torques: rotor of drive m, which never turns$"),
        (STEPS, "torque", "Fcp2", "grouped into FcnR1: (?!.*constant)"),
    ],
)
def test_reasons_say_why(robot, form, name, reason):
    assert re.match(reason, derive_reasons(robot, form=form)[name])


def test_a_rule_is_said_once_for_all_members_that_it_is_true_for():
    """Of a chain of any length, one clause a rule; and a reason names every member."""
    for robot in (PANDA, TWO_LINK, SLIDES, build_chain(ELBOW, rotors=True)):
        for entry in derive_base_parameters(robot).parameters:
            clauses = [clause.partition(": ") for clause in entry.reason.split("; ")]
            rules = [rule for _, _, rule in clauses]
            assert len(set(rules)) == len(rules)
            members = [write_label(robot, label) for label, _ in entry.terms[1:]]
            named = [name for names, _, _ in clauses for name in names.split(", ")]
            assert sorted(named) == sorted(members or ["identifiable on its own"])
