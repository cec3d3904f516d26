"""A robot that is written and read again is the same robot: placements exactly, values to the last digits."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
from hypothesis import given, settings, strategies as st

from symid.joint_models import FrictionValues, get_law, has_sign
from symid.joint_models.hysteresis import Elasticity, Knee, Stop
from symid.robot import description
from symid.robot.geometry import (
    IDENTITY,
    ZERO,
    Exact,
    Placement,
    build_exact_angle,
    build_tangent_angle,
    compose_placements,
    rotate_rpy,
    rotate_x,
    rotate_y,
    rotate_z,
    translate,
)
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot
from tests.chains import draw_parameters
from tests.friction_forms import EVERY_LAW

FRACTIONS = st.fractions(-3, 3, max_denominator=1000)
NUMBERS = st.floats(-100, 100, allow_nan=False).filter(lambda x: x == 0 or abs(x) > 1e-20)
POSITIVE = st.floats(1e-6, 1e3)
SURDS = st.builds(Exact.surd, FRACTIONS, FRACTIONS, FRACTIONS, FRACTIONS)
ANGLES = st.one_of(
    st.integers(-12, 12).map(lambda k: build_exact_angle(k * np.pi / 12)),
    st.floats(-3.1, 3.1).map(build_exact_angle),
    # Within the distance that is snapped when it is written as a decimal.
    st.floats(-1e-6, 1e-6).map(lambda x: build_exact_angle(x, snap=0.0)),
    st.fractions(-50, 50, max_denominator=10**12).map(lambda t: build_tangent_angle(Exact.of(t))),
)
LENGTHS = st.one_of(
    st.decimals(-2, 2, places=5).map(lambda x: Exact.of(str(x))),
    SURDS,
    st.fractions(-2, 2, max_denominator=10**20).map(Exact.of),
    FRACTIONS.map(lambda x: Exact.of(x) * Exact.symbol("L1") + Exact.of("0.1")),
)
TURNS = st.one_of(
    ANGLES.map(rotate_x),
    ANGLES.map(rotate_z),
    st.tuples(ANGLES, ANGLES, ANGLES).map(lambda angles: rotate_rpy(*angles)),
    # Products whose pitch has a cosine outside of the field.
    st.tuples(ANGLES, ANGLES, ANGLES).map(
        lambda a: compose_placements(rotate_x(a[0]), compose_placements(rotate_y(a[1]), rotate_x(a[2])))
    ),
)


SHARED_LAWS = tuple(name for name in EVERY_LAW if get_law(name).inputs == ("velocity",))


@st.composite
def placements(draw):
    turn = draw(TURNS)
    translation = draw(st.one_of(st.just(IDENTITY.translation), st.tuples(LENGTHS, LENGTHS, LENGTHS)))
    return Placement(rotation=turn.rotation, translation=translation)


@st.composite
def frictions(draw, *, shared=False):
    """Any static law; that of `shared` drives depends on the velocity alone."""
    name = draw(st.sampled_from(["none", *(SHARED_LAWS if shared else EVERY_LAW)]))
    if name == "none":
        return FrictionValues()
    law = get_law(name)
    values = draw(st.one_of(st.none(), st.tuples(*[NUMBERS] * len(law.linear))))
    # Some have no step at standstill to smooth.
    smoothing = draw(st.one_of(st.just(0.0), POSITIVE)) if has_sign(law) else 0.0
    numbers = st.floats(1e-3, 9.0)
    shape = draw(st.tuples(*[numbers] * len(law.shape)))
    return FrictionValues(law=name, values=values, smoothing=smoothing, shape=shape)


UNKNOWN = st.one_of(st.none(), POSITIVE)
SLOPES = st.floats(-0.3, 2.0).filter(lambda x: abs(x) > 1e-20)
MANY = st.lists(POSITIVE, max_size=3, unique=True).map(sorted)


@st.composite
def elasticities(draw):
    """Springs with stops, and knees on both sides or the same on both, or a cubic part."""
    above = [Knee(threshold=place, slope=draw(SLOPES)) for place in draw(MANY)]
    mirrored = draw(st.booleans())
    below = above if mirrored else [Knee(threshold=place, slope=draw(SLOPES)) for place in draw(MANY)]
    below = [Knee(threshold=-knee.threshold, slope=knee.slope) for knee in reversed(below)]
    return Elasticity(
        stiffness=draw(UNKNOWN),
        damping=draw(st.one_of(st.just(0.0), POSITIVE)),
        cubic=0.0 if above or below else draw(st.one_of(st.just(0.0), POSITIVE)),
        stops=tuple(Stop(threshold=place, stiffness=draw(UNKNOWN)) for place in draw(MANY)),
        knees=(*below, *above),
    )


DRIVES = st.one_of(
    st.builds(description.Drive, gear=NUMBERS.filter(bool), torque_constant=st.one_of(st.none(), NUMBERS)),
    st.builds(
        description.Drive,
        gear=NUMBERS.filter(bool),
        has_rotor=st.just(True),
        rotor_inertia=st.one_of(UNKNOWN, st.just(0.0)),
    ),
)
BODIES = st.integers(0, 2**32 - 1).map(
    lambda seed: tuple(draw_parameters(np.random.default_rng(seed), 1)[0].tolist())
)


@st.composite
def joints(draw, index):
    low, high = sorted(draw(st.tuples(NUMBERS, NUMBERS)))
    position = (low, high) if low < high else None
    follows = index > 0 and draw(st.booleans())
    return description.Joint(
        name=draw(st.text(min_size=1, max_size=6).filter(lambda x: x.strip() and x != "base")) + str(index),
        kind=draw(st.sampled_from(description.JointKind)),
        parent=draw(st.integers(-1, index - 1)),
        placement=draw(placements()),
        frame=draw(st.one_of(st.just(IDENTITY), placements())),
        inertial=draw(st.one_of(st.none(), BODIES)),
        drive=draw(DRIVES),
        friction=draw(frictions(shared=follows)),
        limits=description.Limits(position=position, velocity=draw(UNKNOWN), torque=draw(UNKNOWN)),
        mimic=description.Mimic(master=0, multiplier=draw(FRACTIONS.filter(bool))) if follows else None,
        spring=draw(st.one_of(st.none(), st.builds(description.Spring, stiffness=UNKNOWN, rest=UNKNOWN))),
        elasticity=draw(st.one_of(st.none(), elasticities())),
    )


@st.composite
def robots(draw):
    found = tuple(draw(joints(index)) for index in range(draw(st.integers(1, 3))))
    terms = tuple((index, draw(FRACTIONS.filter(bool))) for index in range(len(found)))
    shared = draw(frictions(shared=True))
    coupling = description.Coupling(name="m6", terms=terms, has_rotor=draw(st.booleans()), friction=shared)
    return description.Robot(
        name="arm",
        description=draw(st.text(st.characters(codec="utf-8"), max_size=9)),
        joints=found,
        gravity=draw(st.tuples(SURDS, SURDS, SURDS)),
        symbols=(("L1", 0.25),),
        convention=draw(st.sampled_from(["modified", "standard", "urdf"])),
        couplings=draw(st.sampled_from([(), (coupling,)])),
    )


@settings(max_examples=40)
@given(robots(), st.booleans())
def test_a_written_robot_is_read_as_the_same(robot, hints):
    text = write_robot(robot, comment="Made by hand.\nOr not.", hints=hints)
    again = parse_robot(text, "arm.toml")
    for mine, other in zip(robot.joints, again.joints, strict=True):
        assert (mine.inertial is None) == (other.inertial is None)
        if mine.inertial is not None:
            np.testing.assert_allclose(other.inertial, mine.inertial, rtol=0, atol=1e-11)
    bare = [tuple(replace(joint, inertial=None) for joint in x.joints) for x in (robot, again)]
    assert bare[0] == bare[1]
    same = ("name", "description", "gravity", "symbols", "couplings", "log", "processing")
    assert [getattr(robot, name) for name in same[:-1]] == [getattr(again, name) for name in same[:-1]]


def make_joint(name="a", *, kind=description.JointKind.REVOLUTE, parent=-1, placement=IDENTITY, **fields):
    return description.Joint(name=name, kind=kind, parent=parent, placement=placement, **fields)


@given(st.lists(st.tuples(ANGLES, LENGTHS, LENGTHS, ANGLES), min_size=1, max_size=3), st.booleans())
def test_rows_stay_rows(rows, standard):
    convention = "standard" if standard else "modified"
    joints, frame = [], IDENTITY
    for index, (alpha, a, d, theta) in enumerate(rows):
        aside = translate(a, ZERO, ZERO)
        before = compose_placements(rotate_x(alpha), aside)
        turned = compose_placements(translate(ZERO, ZERO, d), rotate_z(theta))
        after = compose_placements(aside, rotate_x(alpha))
        placement = compose_placements(frame, turned) if standard else compose_placements(before, turned)
        frame = after if standard else IDENTITY
        joints.append(make_joint(f"j{index}", parent=index - 1, placement=placement, frame=frame))
    robot = description.Robot(name="arm", joints=tuple(joints), convention=convention, symbols=(("L1", 1.0),))
    text = write_robot(robot)
    assert "origin" not in text
    again = parse_robot(text)
    assert again.joints == robot.joints
    assert again.convention == convention


def test_symbols_of_links_and_settings_are_written():
    zero = Exact()
    form = description.SymbolicInertia(
        mass=Exact.symbol("m1"),
        com=(Exact.symbol("lc1"), zero, -Exact.symbol("lc1")),
        inertia=(Exact.symbol("I1"), zero, zero, Exact.symbol("I1"), zero, Exact.of(Fraction(1, 3))),
    )
    joint = make_joint(form=form)
    log = description.LogMap(
        time=description.LogQuantity(columns=("t",), unit="ms"),
        torque=description.LogQuantity(columns=('u "left"',), unit="V", factor=(35.15,), side="motor"),
    )
    processing = description.Processing(
        filter_cutoff=50.0, standstill=0.1, decimation=description.Decimation(factor=4)
    )
    symbols = (("I1", 0.5), ("lc1", 0.1), ("m1", 2.0))
    named = (
        description.NamedSettings(name="lab", log=log),
        description.NamedSettings(name="plain", processing=description.Processing()),
    )
    robot = description.Robot(
        name="arm", joints=(joint,), symbols=symbols, log=log, processing=processing, settings=named
    )
    again = parse_robot(write_robot(robot))
    assert again.joints[0].form == form
    assert (again.log, again.processing, again.symbols) == (log, processing, symbols)
    assert again.settings == named


def test_values_that_no_body_has_are_written_as_they_are():
    weightless = make_joint(inertial=(1.0,) + (0.0,) * 9)
    nothing = replace(weightless, name="c", parent=1, inertial=(0.0,) * 10)
    impossible = replace(weightless, name="b", parent=0, inertial=(3.0, 0, 0, 1, 0, 1, 0, 0, 0, 1.0))
    aside = translate(Exact.of("0.1"), ZERO, Exact.of("-0.2"))
    frame = compose_placements(rotate_x(build_exact_angle(0.3)), aside)
    framed = replace(impossible, name="d", parent=2, frame=frame)
    joints = (weightless, impossible, nothing, framed)
    again = parse_robot(write_robot(description.Robot(name="1 arm!", joints=joints)))
    assert again.name == "robot_1_arm_"
    assert [joint.inertial for joint in again.joints[:3]] == [joint.inertial for joint in joints[:3]]
    np.testing.assert_allclose(again.joints[3].inertial, framed.inertial, rtol=0, atol=1e-13)
    # A kilogram with 3 kg m^2 is as large as no part of such a robot.
    told = ("inertia-without-mass", *["implausible-body", "impossible-inertia"] * 2)
    assert sorted(notice.code for notice in again.notices) == sorted(f"robot.{code}" for code in told)


def test_a_negative_mass_is_left_out_and_said():
    joint = make_joint(inertial=(0.0,) * 9 + (-1.0,))
    text = write_robot(description.Robot(name="arm", joints=(joint,)))
    assert "# the link's values" in text
    assert parse_robot(text).joints[0].inertial is None


def write_hints(**fields):
    """Return a file with hints of a turning and a sliding joint, and with their marks taken away."""
    kinds = {"turn": description.JointKind.REVOLUTE, "slide": description.JointKind.PRISMATIC}
    joints = tuple(make_joint(name, kind=kind, **fields) for name, kind in kinds.items())
    text = write_robot(description.Robot(name="arm", joints=joints), comment="Made by hand.", hints=True)
    head, _, body = text.partition("\n")
    assert head == "# Made by hand."
    return text, "\n".join(line.removeprefix("# ") for line in body.split("\n"))


def test_hints_without_their_marks_are_valid():
    _, filled = write_hints()
    for joint in parse_robot(filled).joints:
        assert joint.inertial is not None
        assert joint.drive.has_rotor
        assert joint.friction.values == (1.0, 2.0, 0.0)
        assert joint.elasticity == Elasticity()
        assert joint.limits.torque == 50.0
        assert (joint.limits.acceleration, joint.limits.jerk) == (10.0, 100.0)


def test_hints_complete_tables_that_are_there():
    drive = description.Drive(gear=50.0)
    limits = description.Limits(position=(-1.0, 2.0), velocity=3.0)
    text, filled = write_hints(drive=drive, limits=limits)
    assert (text.count("[joint.drive]"), text.count("[joint.limits]")) == (2, 2)
    full = description.Drive(gear=50.0, has_rotor=True, rotor_inertia=1e-5 * 50.0**2, torque_constant=0.1)
    for joint in parse_robot(filled).joints:
        assert joint.drive == full
        assert joint.limits == replace(limits, torque=50.0, acceleration=10.0, jerk=100.0)
