"""Base parameters against the closed-form grouping relations of the textbooks, as expressions.

For a revolute joint j of a chain of modified DH rows (alpha, a, d, theta) the textbooks group YY, MZ and M of
link j (Gautier and Khalil 1990; Khalil and Dombre 2002, Modeling, Identification and Control of Robots):

    XXR(j)   = XX(j) - YY(j)
    XXR(j-1) = XX(j-1) + YY(j) + 2 d MZ(j) + d^2 M(j)
    XYR(j-1) = XY(j-1) + a sin(alpha) (MZ(j) + d M(j))
    XZR(j-1) = XZ(j-1) - a cos(alpha) (MZ(j) + d M(j))
    YYR(j-1) = YY(j-1) + cos^2(alpha) (YY(j) + 2 d MZ(j)) + (a^2 + d^2 cos^2(alpha)) M(j)
    YZR(j-1) = YZ(j-1) + cos(alpha) sin(alpha) (YY(j) + 2 d MZ(j) + d^2 M(j))
    ZZR(j-1) = ZZ(j-1) + sin^2(alpha) (YY(j) + 2 d MZ(j)) + (a^2 + d^2 sin^2(alpha)) M(j)
    MXR(j-1) = MX(j-1) + a M(j)
    MYR(j-1) = MY(j-1) - sin(alpha) (MZ(j) + d M(j))
    MZR(j-1) = MZ(j-1) + cos(alpha) (MZ(j) + d M(j))
    MR(j-1)  = M(j-1) + M(j)

from the last joint to the first. Of the first link, and of links that turn about parallel axes only, ZZ, MX
and MY are left, MX and MY unless that axis is parallel to gravity.
"""

import pytest
from sympy import Rational, Symbol, cos, expand, pi, sin, sympify

from symid.dynamics.base_parameters import derive_base_parameters
from symid.notation import INERTIAL
from tests.chains import PI, build_chain

VERTICAL, LYING = ("0", "0", "-9.81"), ("0", "-9.81", "0")
LEFT_OUT = ("YY", "MZ", "M")
PLANAR = ("ZZ", "MX", "MY")


def exact_length(value):
    return Symbol(value) if isinstance(value, str) else Rational(str(value))


def exact_angle(value):
    twelfths = round(value / (PI / 12))
    assert abs(value - twelfths * PI / 12) < 1e-9
    return pi * Rational(twelfths, 12)


def group_links(rows):
    """Return the grouped parameters of all links as expressions, by the relations above."""
    links = [{name: Symbol(f"{name}{j}") for name in INERTIAL} for j in range(1, len(rows) + 1)]
    for j in reversed(range(len(rows))):
        own = links[j]
        yy, mz, mass = own["YY"], own["MZ"], own["M"]
        own["XX"] -= yy
        for name in LEFT_OUT:
            own[name] = sympify(0)
        if j == 0:
            break
        before, (alpha, a, d, _) = links[j - 1], rows[j]
        a, d = exact_length(a), exact_length(d)
        c, s = cos(exact_angle(alpha)), sin(exact_angle(alpha))
        before["XX"] += yy + 2 * d * mz + d**2 * mass
        before["XY"] += a * s * (mz + d * mass)
        before["XZ"] -= a * c * (mz + d * mass)
        before["YY"] += c**2 * (yy + 2 * d * mz) + (a**2 + d**2 * c**2) * mass
        before["YZ"] += c * s * (yy + 2 * d * mz + d**2 * mass)
        before["ZZ"] += s**2 * (yy + 2 * d * mz) + (a**2 + d**2 * s**2) * mass
        before["MX"] += a * mass
        before["MY"] -= s * (mz + d * mass)
        before["MZ"] += c * (mz + d * mass)
        before["M"] += mass
    return links


def list_textbook(rows, *, vertical):
    """Return {label: expression} of the base parameters by the relations and rules above."""
    result = {}
    parallel = True
    for j, link in enumerate(group_links(rows)):
        parallel = parallel and (j == 0 or exact_angle(rows[j][0]) in (0, pi))
        names = [name for name in INERTIAL if name not in LEFT_OUT]
        if parallel:
            names = list(PLANAR)
        # Turning about an axis along gravity lifts nothing; links behind it are also carried round.
        if j == 0 and vertical:
            names = ["ZZ"]
        result |= {(j, name): link[name] for name in names if link[name] != 0}
    return result


def write_terms(parameter, lengths=()):
    return sum(
        value.subs(dict(lengths)) * Symbol(f"{name}{index + 1}") for (index, name), value in parameter.terms
    )


def assert_textbook(rows, gravity):
    robot = build_chain(rows, gravity=gravity)
    found = {p.label: write_terms(p) for p in derive_base_parameters(robot).parameters}
    expected = list_textbook(rows, vertical=gravity == VERTICAL)
    assert list(found) == list(expected)
    for label, expression in expected.items():
        assert expand(found[label] - expression) == 0, label


PLANAR_2R = [(0.0, 0, 0, "q"), (0.0, "L1", 0, "q")]
PLANAR_3R = [(0.0, 0, 0, "q"), (0.0, "L1", 0, "q"), (0.0, "L2", 0, "q")]
SPATIAL_2R = [(0.0, 0, 0, "q"), (PI / 2, "A2", "D2", "q")]
SPATIAL_3R = [(0.0, 0, 0, "q"), (PI / 2, "A2", "D2", "q"), (0.0, "A3", "D3", "q")]
SKEW_3R = [(0.0, 0, 0, "q"), (PI / 2, "A2", "D2", "q"), (PI / 6, "A3", "D3", "q")]
TILTED_3R = [(0.0, 0, 0, "q"), (PI / 4, "A2", "D2", "q"), (-PI / 3, "A3", "D3", "q")]


def build_rows(twists, lengths, offsets):
    """Return rows of twists in right angles, and of (a, d) by joint, zero where none is given."""
    return [
        (twist * PI / 2, lengths.get(k, 0), offsets.get(k, 0), "q") for k, twist in enumerate(twists, start=1)
    ]


PUMA = build_rows((0, 1, 0, -1, 1, -1), {3: "A3", 4: "A4"}, {3: "D3", 4: "D4"})
LWR = build_rows((0, 1, -1, -1, 1, 1, -1), {}, {3: "D3", 5: "D5"})
CHAINS = {
    "planar 2R": (PLANAR_2R, LYING),
    "planar 3R": (PLANAR_3R, LYING),
    "spatial 2R": (SPATIAL_2R, VERTICAL),
    "spatial 2R, gravity across": (SPATIAL_2R, LYING),
    "spatial 3R": (SPATIAL_3R, VERTICAL),
    "skew 3R": (SKEW_3R, VERTICAL),
    "skew 3R, gravity across": (SKEW_3R, LYING),
    "tilted 3R": (TILTED_3R, VERTICAL),
    "PUMA": (PUMA, VERTICAL),
    "LWR": (LWR, VERTICAL),
    "PUMA in numbers": (
        build_rows((0, 1, 0, -1, 1, -1), {3: 0.4318, 4: 0.0203}, {3: 0.15005, 4: 0.4318}),
        VERTICAL,
    ),
    "Panda in numbers": (
        build_rows(
            (0, -1, 1, 1, -1, 1, 1), {4: 0.0825, 5: -0.0825, 7: 0.088}, {1: 0.333, 3: 0.316, 5: 0.384}
        ),
        VERTICAL,
    ),
}


@pytest.mark.parametrize("name", CHAINS)
def test_grouping_is_that_of_the_textbook(name):
    assert_textbook(*CHAINS[name])


def test_planar_three_links_as_printed():
    """Khalil and Dombre 2002: nine parameters, masses beyond a joint act at its distance."""
    assert list_expressions(build_chain(PLANAR_3R, gravity=LYING)) == {
        "ZZR1": "ZZ1 + L1^2*M2 + L1^2*M3",
        "MXR1": "MX1 + L1*M2 + L1*M3",
        "ZZR2": "ZZ2 + L2^2*M3",
        "MXR2": "MX2 + L2*M3",
        **{name: name for name in ("MY1", "MY2", "ZZ3", "MX3", "MY3")},
    }


def test_planar_arm_on_a_table_shows_no_first_moment_of_link_1():
    assert list(list_expressions(build_chain(PLANAR_2R, gravity=VERTICAL))) == ["ZZR1", "ZZ2", "MX2", "MY2"]


def list_expressions(robot):
    return {p.name: p.expression for p in derive_base_parameters(robot).parameters}


def test_rotors_of_the_first_joints_stand_with_their_links():
    """Gautier and Khalil 1990: IA groups with ZZ where the joint's rotor feels what its link feels."""
    robot = build_chain(PUMA, rotors=True)
    base = derive_base_parameters(robot)
    grouped = {p.name: p.expression for p in base.parameters if "IA" in p.expression}
    assert [name for name in grouped if name.startswith("ZZR")] == ["ZZR1", "ZZR2"]
    assert [name for name in grouped if name.startswith("IA")] == ["IA3", "IA4", "IA5", "IA6"]
    assert base.count == 36 + 4


def test_a_prismatic_link_adds_its_inertia_to_the_link_before():
    """Gautier and Khalil 1990: the inertia of a prismatic link is that of the link before, turned.

    Frame 3 is frame 2 turned about x by 90 degrees: x3 = x2, y3 = z2, z3 = -y2.
    """
    rows = [(0.0, 0, 0, "q"), (PI / 2, "A2", 0, "q"), (PI / 2, "A3", "q", 0.0)]
    assert list_expressions(build_chain(rows)) == {
        "ZZR1": "ZZ1 + YY2 + A2^2*M2 + ZZ3",
        "XXR2": "XX2 - YY2 + XX3 - ZZ3",
        "XYR2": "XY2 - XZ3",
        "XZR2": "XZ2 + XY3",
        "YZR2": "YZ2 - YZ3",
        "ZZR2": "ZZ2 + YY3",
        **{name: name for name in ("MX2", "MY2", "MX3", "MY3", "MZ3", "M3")},
    }


def test_textbook_count_of_a_chain_without_parallel_axes():
    """7 n - 6 parameters with a vertical first joint, 7 n - 4 else (Khalil and Dombre 2002)."""
    for size in (2, 3, 4):
        rows = [(0.0, 0, 0, "q"), *[(PI / 2, 0.1, 0.2, "q")] * (size - 1)]
        assert derive_base_parameters(build_chain(rows)).count == 7 * size - 6
        assert derive_base_parameters(build_chain(rows, gravity=LYING)).count == 7 * size - 4
