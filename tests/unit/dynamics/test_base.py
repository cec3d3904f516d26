"""Base sets by form, null space, standard parameters, names of coupled drives and springs."""

from dataclasses import replace
from fractions import Fraction

import pytest

from symid.dynamics.base_parameters import BASE_FORMS, build_standard_parameters, derive_base_parameters
from symid.dynamics.explanations import get_label_unit
from symid.errors import RobotError
from symid.joint_models import FrictionValues
from symid.robot.description import Coupling, Mimic, Spring
from tests.chains import PANDA, PI, PUMA560, TWO_LINK, build_chain
from tests.refusals import raises


@pytest.mark.parametrize(
    ("robot", "counts"),
    [(TWO_LINK, (6, 6, 4, 4)), (PUMA560, (36, 36, 34, 10)), (PANDA, (43, 43, 39, 12))],
    ids=lambda value: getattr(value, "name", ""),
)
def test_counts_by_form(robot, counts):
    assert tuple(derive_base_parameters(robot, form=form).count for form in BASE_FORMS) == counts


def test_other_forms_are_refused():
    with pytest.raises(ValueError, match="form 'power'; allowed are torque"):
        derive_base_parameters(TWO_LINK, form="power")


def test_a_form_without_motion_says_so():
    reasons = {
        entry.name: entry.reason for entry in derive_base_parameters(TWO_LINK, form="gravity").eliminated
    }
    assert reasons["ZZ2"] == "no effect on torques at rest: link 2 turns about its z axis only"
    reasons = {
        entry.name: entry.reason for entry in derive_base_parameters(TWO_LINK, form="momentum").eliminated
    }
    assert reasons["MX1"].startswith("no effect on the momentum:")


@pytest.mark.parametrize("robot", [TWO_LINK, PUMA560, PANDA], ids=lambda robot: robot.name)
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


def test_a_coupled_drive_has_parameters_of_its_own_name():
    friction = FrictionValues(law="coulomb-viscous")
    coupling = Coupling(
        name="m2", terms=((0, Fraction(1)), (1, Fraction(1))), has_rotor=True, friction=friction
    )
    robot = replace(build_chain([(0.0, 0, 0, "q"), (PI / 2, 0, 0, "q")], rotors=True), couplings=(coupling,))
    base = derive_base_parameters(robot)
    reasons = {parameter.name: parameter.reason for parameter in (*base.parameters, *base.friction)}
    assert reasons["IAm2"].startswith("rotor of drive m2, ")
    assert reasons["Fvm2"].startswith("friction of drive m2, ")
    assert all(" joints 1, 2" in reasons[name] for name in ("IAm2", "Fvm2"))


def test_the_friction_of_a_follower_adds_to_its_masters():
    robot = build_chain([(0.0, 0, 0, "q"), (PI / 2, 0, 0, "q")], friction="coulomb-viscous")
    joints = (robot.joints[0], replace(robot.joints[1], mimic=Mimic(master=0, multiplier=Fraction(-2))))
    base = derive_base_parameters(replace(robot, joints=joints))
    # Fv acts through the ratio twice, Fc once, whatever its sign.
    assert [entry.expression for entry in base.friction] == ["Fv1 + 4*Fv2", "Fc1 + 2*Fc2"]
    reasons = {entry.name: entry.reason for entry in base.eliminated}
    assert reasons["Fv2"].startswith("grouped into FvR1: ")
    assert any("joint 2 moves only" in reason for reason in reasons.values())


def test_springs_show_and_their_preload_joins_an_offset():
    robot = build_chain([(0.0, 0, 0, "q")], friction="coulomb-viscous-offset")
    sprung = replace(robot, joints=(replace(robot.joints[0], spring=Spring()),))
    base = derive_base_parameters(sprung)
    names = {parameter.name: parameter for parameter in base.parameters}
    assert names["KS1"].reason.startswith("spring of joint 1, ")
    assert names["KRR1"].expression == "KR1 + offset1"


def test_an_offset_shared_by_a_coupled_drive_is_explained():
    friction = FrictionValues(law="coulomb-viscous-offset")
    robot = build_chain([(0.0, 0, 0, "q")] * 2, friction="coulomb-viscous-offset")
    coupling = Coupling(name="m", terms=((0, Fraction(1)), (1, Fraction(1))), friction=friction)
    base = derive_base_parameters(replace(robot, couplings=(coupling,)))
    reasons = {entry.name: entry.reason for entry in base.eliminated}
    assert reasons["offsetm"].startswith("grouped into offsetR1, offsetR2: it is a constant torque")


def test_units_and_reasons_of_a_drive_that_turns_and_slides():
    rows = [(0.0, 0, 0, "q"), (PI / 3, 0, "q", 0.0)]
    mixed = Coupling(name="m", terms=((1, Fraction(1)), (0, Fraction(1))), has_rotor=True)
    robot = replace(build_chain(rows, rotors=True), couplings=(mixed,))
    assert get_label_unit(robot, (2, "IA")) == "kg m^2", "whatever the order of its joints"
    slides = replace(mixed, terms=((1, Fraction(1)),))
    assert get_label_unit(replace(robot, couplings=(slides,)), (2, "IA")) == "kg"


def test_reasons_without_a_contradiction():
    robot = build_chain([(0.0, 0, 0, "q")], friction="coulomb-viscous-offset")
    sprung = replace(robot, joints=(replace(robot.joints[0], spring=Spring()),))
    base = derive_base_parameters(sprung)
    (preload,) = [parameter for parameter in base.parameters if parameter.name == "KRR1"]
    assert preload.reason.startswith("spring of joint 1; ")
    assert " with offset1: it is a constant torque at joint 1, like KR1" in preload.reason
    reasons = {
        entry.name: entry.reason for entry in derive_base_parameters(sprung, form="momentum").eliminated
    }
    assert reasons["KS1"] == "no effect on the momentum: spring of joint 1"


def test_a_drive_whose_factors_cancel_stands_still():
    robot = build_chain([(0.0, 0, 0, "q"), (PI / 2, 0, 0, "q")])
    joints = (robot.joints[0], replace(robot.joints[1], mimic=Mimic(master=0, multiplier=Fraction(-1))))
    drive = Coupling(name="m", terms=((0, Fraction(1)), (1, Fraction(1))), has_rotor=True)
    base = derive_base_parameters(replace(robot, joints=joints, couplings=(drive,)))
    reasons = {entry.name: entry.reason for entry in base.eliminated}
    assert reasons["IAm"].startswith("no effect on joint torques: rotor of drive m, ")
    assert "cancel" in reasons["IAm"]


def test_the_steps_of_a_follower_are_no_constants():
    robot = build_chain([(0.0, 0, 0, "q"), (PI / 2, 0, 0, "q")], friction="asymmetric")
    joints = (robot.joints[0], replace(robot.joints[1], mimic=Mimic(master=0, multiplier=Fraction(-1, 2))))
    base = derive_base_parameters(replace(robot, joints=joints))
    reasons = {entry.name: entry.reason for entry in base.eliminated}
    assert reasons["Fcp2"].startswith("grouped into FcnR1: ")
    assert "constant" not in reasons["Fcp2"]


def test_what_would_not_end_is_refused():
    robot = build_chain([(PI / 6, 0, 0, "q"), (-PI / 2, 0.1, 0, "q"), (-PI / 2, "A2", 0, "q")])
    joints = [replace(joint, mimic=Mimic(master=1, multiplier=Fraction(-1))) for joint in robot.joints]
    shared = replace(robot, joints=(joints[0], robot.joints[1], joints[2]))
    with raises(RobotError, "robot.too-symbolic", match=r"\(A2\).* joint1, joint2, joint3:"):
        derive_base_parameters(shared)
    alone = replace(robot, joints=(robot.joints[0], robot.joints[1], joints[2]))
    assert derive_base_parameters(alone).count > 0, "two joints on one coordinate are no trouble"
