"""The derivation for people: its statements, its checks, and what happens when a check fails."""

import re
from dataclasses import replace
from fractions import Fraction

import pytest

from symid.dynamics.exact_algebra import write_name_latex
from symid.errors import SymidError
from symid.joint_models import get_law
from symid.lessons import derivation as lesson
from symid.lessons.derivation import derive_lesson
from symid.lessons.friction_formulas import write_friction
from symid.robot.description import Coupling, Mimic, Spring
from symid.robot.toml_reader import parse_robot
from tests.chains import PANDA, PI, TWO_LINK, build_chain
from tests.refusals import raises
from tests.state_laws import LAWS, write_table


def find_formula(steps, left):
    return next(formula for step in steps for formula in step.formulas if formula.left == left)


def test_two_link_torque_is_the_textbook_one():
    steps = derive_lesson(build_chain([(0.0, 0, 0, "q"), (0.0, "L1", 0, "q")], gravity=("0", "-9.81", "0")))
    titles = ["Frames", "Velocities", "Energy", "Base parameters"]
    titles += ["Inertia matrix", "Coriolis matrix", "Gravity", "Torques"]
    assert [step.title for step in steps] == titles
    # tau_2 of the planar arm per MX2: L1 c2 ddq1 + L1 s2 dq1^2 + g c12 (Khalil and Dombre 2002).
    text = find_formula(steps, "dtau2/dMX2").text
    assert text == "L1*c2*ddq1 + L1*dq1^2*s2 + 981*c1*c2/100 - 981*s1*s2/100"
    assert find_formula(steps, "v2x").latex == r"L_{1} \dot q_{1} s_{2}"


def test_every_check_was_made_also_of_a_weight_that_stays_up():
    # A symbolic height gives links a potential that no coordinate changes.
    scara = build_chain([(0.0, 0, "D1", "q"), (0.0, "L1", 0, "q"), (0.0, "L2", "q", 0.0)])
    for robot, count in ((TWO_LINK, 4), (PANDA, 2), (scara, 4)):
        checks = [step.check for step in derive_lesson(robot) if step.check]
        assert len(checks) == count
        assert all(check.startswith("verified exactly") for check in checks)
    robot = build_chain([(PI / 4, 0, "q", 0.0), (0.0, 0.1, 0, "q"), (PI / 2, 0, 0, "q"), (0.0, 0.2, 0, "q")])
    assert "rational point" in derive_lesson(robot)[-1].check


def test_groups_counts_and_long_sums_are_written_properly():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, "L1", 0, "q")], gravity=("0", "-9.81", "0"))
    assert find_formula(derive_lesson(arm), "ZZR1").latex == r"ZZ_{1} + M_{2} L_{1}^{2}"
    slide = build_chain([(0.0, 0, "q", 0.0)], rotors=True, friction="coulomb-viscous-offset")
    sentence = next(step.sentence for step in derive_lesson(slide) if step.title == "Base parameters")
    assert re.findall(r"\d+", sentence) == ["11", "2"]
    texts = [formula.text for step in derive_lesson(PANDA) for formula in step.formulas]
    assert any("more terms)" in text for text in texts)


@pytest.mark.parametrize("robot", [TWO_LINK, PANDA], ids=lambda r: r.name)
def test_a_contradiction_is_never_printed_as_a_result(monkeypatch, robot):
    original = lesson.dynamics.compute_torque_columns

    def wrong(recursion, keys):
        columns = dict(original(recursion, keys))
        columns[keys[0]] = [entry + recursion.algebra.one for entry in columns[keys[0]]]
        return columns

    monkeypatch.setattr(lesson.dynamics, "compute_torque_columns", wrong)
    with raises(SymidError, "dynamics.contradiction", match="contradicts itself") as caught:
        derive_lesson(robot)
    assert caught.value.exit_code == 70


def test_followers_drives_and_static_friction_are_introduced():
    robot = build_chain([(0.0, 0, 0, "q"), (PI / 2, 0, 0, "q"), (0.3, 0.1, "q", 0.0)])
    joints = list(robot.joints)
    joints[1] = replace(joints[1], mimic=Mimic(master=0, multiplier=Fraction(-63, 100)), spring=Spring())
    drive = Coupling(name="m", terms=((0, Fraction(1)), (2, Fraction(-1, 2))), has_rotor=True)
    frames, _, energy, *_, torques = derive_lesson(replace(robot, joints=tuple(joints), couplings=(drive,)))
    words = {formula.left: formula.text for formula in frames.formulas}
    assert words["joint 2 (joint2)"].endswith("joint 1: q2 = -63/100*q1")
    assert words["drive m"] == "dq1 - 1/2*dq3"
    assert not [formula for formula in energy.formulas if formula.text == "0"]
    assert "same polynomials" in torques.check
    table = 'model = "stribeck"\nvs = 0.1'
    step = derive_lesson(parse_robot(FRICTION.format(friction=table)))[-1]
    assert "a: stribeck (Armstrong-Helouvry" in step.sentence
    assert step.formulas[0].text == get_law("stribeck").formula
    assert not step.check


def test_left_sides_in_latex():
    for left, latex in (
        ("dT/dZZR1", r"\frac{\partial T}{\partial ZZR_{1}}"),
        ("dtau2/dM3", r"\frac{\partial \tau_{2}}{\partial M_{3}}"),
        ("w12x", r"\omega_{12,x}"),
        ("IAm_6", r"\mathit{IAm\_6}"),
        ("joint 1 (a_b)", r"\text{joint 1 (a\_b)}"),
    ):
        assert write_name_latex(left) == latex


FRICTION = """
name = "arm"
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
name = "a"
kind = "revolute"
[joint.friction]
{friction}
"""


@pytest.mark.parametrize("name", LAWS)
def test_friction_with_a_state_has_its_equations_source_and_steady_curve(name):
    step = derive_lesson(parse_robot(FRICTION.format(friction=write_table(name))))[-1]
    law = get_law(name)
    assert step.title == "Friction"
    assert f"a: {name} ({law.source})" in step.sentence
    (formula,) = step.formulas
    assert (formula.left, formula.text) == ("tau_f1", law.formula)
    assert r"\dot z" in formula.latex
    assert formula.latex.endswith(write_friction(law))
    assert (r"\sigma_1 \dot z" in formula.latex) == ("sigma1" in {entry.name for entry in law.memory})
    assert "after a long displacement bristles give the curve of steady sliding" in step.check


def test_bristles_that_end_elsewhere_contradict_the_lesson(monkeypatch):
    monkeypatch.setattr(lesson.joint_models, "advance_memory", lambda *_: (1.0, (0.0,)))
    with raises(SymidError, "dynamics.contradiction", match="do not end at the curve of steady sliding"):
        derive_lesson(parse_robot(FRICTION.format(friction=write_table("dahl"))))
