"""M, C and g of lessons against formulas typed in from books and papers, symbol by symbol.

Sources, and what they leave out:
    Siciliano, Sciavicco, Villani, Oriolo 2009, Robotics, sec. 7.3.2: two-link planar arm; without its motors.
    Craig 2005, Introduction to Robotics, sec. 6.7: two links whose masses are points at their ends.
    Siciliano et al. 2009, sec. 7.1: B = sum of m J_P' J_P + J_O' I J_O, for the planar arm with three joints.
    Murray, Li, Sastry 1994, A Mathematical Introduction to Robotic Manipulation, ch. 4: the SCARA.
    Armstrong, Khatib, Burdick 1986, The explicit dynamic model and inertial parameters of the PUMA 560 arm:
    g, and a22, a23 and a33 (constants summed) without motors, with centres of mass where the paper has them.
    The inertia terms leave out central inertias of the wrist, m6 lz6^2 and a3 lz6, as the paper does where
    it drops what is small.
"""

from dataclasses import replace

import pytest

from symid.lessons.matrices import build_model, derive_equations
from symid.notation import INERTIAL
from symid.robot import load_robot
from tests.chains import PI, build_chain

IN_PLANE = ("0", "-9.81", "0")
PLANAR = {"XX", "YY", "ZZ", "MX", "M"}


def give(robot, *links):
    """Return the robot with links that have the named parameters, the others zero."""
    joints = tuple(
        replace(joint, inertial=tuple(1.0 if name in names else 0.0 for name in INERTIAL))
        for joint, names in zip(robot.joints, links, strict=True)
    )
    return replace(robot, joints=joints)


class Page:
    """A book's page: its formulas as polynomials in our letters."""

    def __init__(self, robot, **letters):
        self.model = build_model(robot, "bodies")
        self.equations = derive_equations(self.model)
        self.algebra, self.known = self.model.algebra, self.model.algebra.generators
        self.letters = letters

    def __getattr__(self, name):
        """Return a letter: s12 and c12 are sums of angles, others those of the model by the book's names."""
        if name[0] in "sc" and name[1:].isdigit():
            s, c = self.algebra.zero, self.algebra.one
            for number in name[1:]:
                sine, cosine = self.known[f"s{number}"], self.known[f"c{number}"]
                s, c = s * cosine + c * sine, c * cosine - s * sine
            return s if name[0] == "s" else c
        return self.known[self.letters.get(name, name)]

    def assert_equal(self, ours, theirs):
        """Compare polynomials, or rows and matrices of them, entry by entry."""
        if isinstance(ours, list | tuple):
            for mine, book in zip(ours, theirs, strict=True):
                self.assert_equal(mine, book)
        else:
            assert self.algebra.reduce(self.algebra.one * theirs - ours) == 0


def build_two_link():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, 0.5, 0, "q")], gravity=IN_PLANE)
    return give(arm, PLANAR, PLANAR)


def test_two_links_are_those_of_siciliano():
    b = Page(build_two_link(), l1="lx1", l2="lx2", a1="a2", I1="I1zz", I2="I2zz")
    found = b.equations
    h = -b.m2 * b.a1 * b.l2 * b.s2
    first = b.I1 + b.m1 * b.l1**2 + b.I2 + b.m2 * (b.a1**2 + b.l2**2 + 2 * b.a1 * b.l2 * b.c2)
    cross = b.I2 + b.m2 * (b.l2**2 + b.a1 * b.l2 * b.c2)
    b.assert_equal(found.mass, ((first, cross), (cross, b.I2 + b.m2 * b.l2**2)))
    b.assert_equal(found.coriolis, ((h * b.dq2, h * (b.dq1 + b.dq2)), (-h * b.dq1, 0)))
    far = b.m2 * b.l2 * b.g * b.c12
    b.assert_equal(found.gravity, ((b.m1 * b.l1 + b.m2 * b.a1) * b.g * b.c1 + far, far))


def test_two_point_masses_are_those_of_craig():
    b = Page(build_two_link(), l2="lx2", l1="a2")
    # Craig's first mass is where the second link begins.
    place = {b.known["lx1"]: b.l1, b.known["I1zz"]: b.algebra.zero, b.known["I2zz"]: b.algebra.zero}

    def put(value):
        for letter, other in place.items():
            value = value.compose(letter, other)
        return value

    found = b.equations
    first = b.l2**2 * b.m2 + 2 * b.l1 * b.l2 * b.m2 * b.c2 + b.l1**2 * (b.m1 + b.m2)
    cross = b.l2**2 * b.m2 + b.l1 * b.l2 * b.m2 * b.c2
    mass = ((first, cross), (cross, b.l2**2 * b.m2))
    swing = b.m2 * b.l1 * b.l2 * b.s2
    velocities = (-swing * b.dq2**2 - 2 * swing * b.dq1 * b.dq2, swing * b.dq1**2)
    gravity = (b.m2 * b.l2 * b.g * b.c12 + (b.m1 + b.m2) * b.l1 * b.g * b.c1, b.m2 * b.l2 * b.g * b.c12)
    for i in range(2):
        b.assert_equal([put(entry) for entry in found.mass[i]], mass[i])
        own = found.coriolis[i][0] * b.dq1 + found.coriolis[i][1] * b.dq2
        b.assert_equal((put(own), put(found.gravity[i])), (velocities[i], gravity[i]))


def test_three_planar_links_are_sums_of_jacobians():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, 0.5, 0, "q"), (0.0, 0.4, 0, "q")], gravity=IN_PLANE)
    b = Page(give(arm, PLANAR, PLANAR, PLANAR), l1="lx1", l2="lx2", l3="lx3", a1="a2", a2="a3")
    zero, one = b.algebra.zero, b.algebra.one
    # Partial Jacobians of the centres of mass, rows x and y.
    first = ((-b.l1 * b.s1, zero, zero), (b.l1 * b.c1, zero, zero))
    second = (
        (-b.a1 * b.s1 - b.l2 * b.s12, -b.l2 * b.s12, zero),
        (b.a1 * b.c1 + b.l2 * b.c12, b.l2 * b.c12, zero),
    )
    tip = b.l3 * b.s123, b.l3 * b.c123
    third = (
        (-b.a1 * b.s1 - b.a2 * b.s12 - tip[0], -b.a2 * b.s12 - tip[0], -tip[0]),
        (b.a1 * b.c1 + b.a2 * b.c12 + tip[1], b.a2 * b.c12 + tip[1], tip[1]),
    )
    turns = ((one, zero, zero), (one, one, zero), (one, one, one))
    links = zip((b.m1, b.m2, b.m3), (b.I1zz, b.I2zz, b.I3zz), (first, second, third), turns, strict=True)
    mass = [[zero] * 3 for _ in range(3)]
    for m, inertia, (x, y), turn in links:
        for i in range(3):
            for j in range(3):
                mass[i][j] += m * (x[i] * x[j] + y[i] * y[j]) + inertia * turn[i] * turn[j]
    b.assert_equal(b.equations.mass, mass)
    weight = b.m3 * b.l3 * b.g * b.c123
    middle = (b.m2 * b.l2 + b.m3 * b.a2) * b.g * b.c12
    low = (b.m1 * b.l1 + (b.m2 + b.m3) * b.a1) * b.g * b.c1
    b.assert_equal(b.equations.gravity, (low + middle + weight, middle + weight, weight))


def test_the_scara_is_that_of_murray_li_and_sastry():
    arm = build_chain([(0.0, 0, 0, "q"), (0.0, 0.5, 0, "q"), (0.0, 0.4, 0, "q"), (0.0, 0, "q", 0.0)])
    still = {"XX", "YY", "ZZ", "M"}
    b = Page(give(arm, PLANAR, PLANAR, still, still), r1="lx1", r2="lx2", l1="a2", l2="a3")
    ends = b.I3zz + b.I4zz
    alpha = b.I1zz + b.r1**2 * b.m1 + b.l1**2 * (b.m2 + b.m3 + b.m4)
    beta = b.I2zz + ends + b.l2**2 * (b.m3 + b.m4) + b.m2 * b.r2**2
    gamma = b.l1 * b.l2 * (b.m3 + b.m4) + b.l1 * b.m2 * b.r2
    mass = (
        (alpha + beta + 2 * gamma * b.c2, beta + gamma * b.c2, ends, 0),
        (beta + gamma * b.c2, beta, ends, 0),
        (ends, ends, ends, 0),
        (0, 0, 0, b.m4),
    )
    swing = gamma * b.s2
    b.assert_equal(b.equations.mass, mass)
    turning = ((-swing * b.dq2, -swing * (b.dq1 + b.dq2), 0, 0), (swing * b.dq1, 0, 0, 0), *((0,) * 4,) * 2)
    b.assert_equal(b.equations.coriolis, turning)
    # Gravity along z, the stroke along z too: q4 rises against it.
    b.assert_equal(b.equations.gravity, (0, 0, 0, b.m4 * b.g))


@pytest.fixture(scope="module")
def puma():
    """The PUMA 560 with the rows and the centres of mass of Armstrong, Khatib and Burdick."""
    rows = [
        (0.0, 0, 0, "q"),
        (-PI / 2, 0, 0, "q"),
        (0.0, 0.4318, 0.1501, "q"),
        (PI / 2, -0.0203, 0.4331, "q"),
        (-PI / 2, 0, 0, "q"),
        (PI / 2, 0, 0, "q"),
    ]
    body = {"XX", "YY", "ZZ", "M"}
    links = (body, body | {"MX", "MY", "MZ"}, body | {"MY", "MZ"}, body | {"MZ"}, body, body | {"MZ"})
    centres = {"rx2": "lx2", "ry2": "ly2", "ry3": "ly3", "rz4": "lz4", "rz6": "lz6"}
    return Page(give(build_chain(rows), *links), a2="a3", a3="a4", **centres)


def test_gravity_of_the_puma_is_that_of_armstrong_khatib_and_burdick(puma):
    b = puma
    wrist = b.m4 + b.m5 + b.m6
    g1 = -b.g * ((b.m3 + wrist) * b.a2 + b.m2 * b.rx2)
    g2 = b.g * (b.m3 * b.ry3 - wrist * b.d4 - b.m4 * b.rz4)
    g3 = b.g * b.m2 * b.ry2
    g4 = -b.g * wrist * b.a3
    g5 = -b.g * b.m6 * b.rz6
    tilted = g2 * b.s23 + g4 * b.c23 + g5 * (b.s23 * b.c5 + b.c23 * b.c4 * b.s5)
    wrist = (-g5 * b.s23 * b.s4 * b.s5, g5 * (b.c23 * b.s5 + b.s23 * b.c4 * b.c5), 0)
    b.assert_equal(b.equations.gravity, (0, g1 * b.c2 + g3 * b.s2 + tilted, tilted, *wrist))


def test_inertia_of_the_puma_is_that_of_armstrong_khatib_and_burdick(puma):
    b = puma
    wrist = b.m4 + b.m5 + b.m6
    i5 = b.a2 * (-b.m3 * b.ry3 + wrist * b.d4 + b.m4 * b.rz4)
    i12, i15, i16 = b.a2 * b.a3 * wrist, b.m6 * b.rz6 * b.d4, b.m6 * b.rz6 * b.a2
    elbow = i5 * b.s3 + i12 * b.c3 + i16 * (b.s3 * b.c5 + b.c3 * b.c4 * b.s5)
    formulas = {(1, 1): 2 * elbow + 2 * i15 * b.c5, (1, 2): elbow + 2 * i15 * b.c5, (2, 2): 2 * i15 * b.c5}
    known = {str(x): k for k, x in enumerate(b.algebra.ring.symbols)}
    turning = [known[f"{kind}{number}"] for kind in "sc" for number in range(1, 7)]
    for (i, j), formula in formulas.items():
        rest = b.algebra.reduce(b.equations.mass[i][j] - formula)
        for monomial in rest:
            if any(monomial[k] for k in turning):
                central = [known[f"I{link}{uu}"] for link in (4, 5, 6) for uu in ("xx", "yy", "zz")]
                small = any(monomial[k] for k in central)
                small |= monomial[known["lz6"]] == 2 or bool(monomial[known["lz6"]] and monomial[known["a4"]])
                assert small, rest.ring.from_dict({monomial: rest[monomial]})


def test_the_shipped_arm_is_in_letters():
    model = build_model(load_robot("two_link_symbols"))
    assert model.form == "symbols"
    k, found = model.algebra.generators, derive_equations(model)
    first = k["I1"] + k["m1"] * k["lc1"] ** 2 + k["I2"]
    second = k["m2"] * (k["L1"] ** 2 + k["lc2"] ** 2 + 2 * k["L1"] * k["lc2"] * k["c2"])
    assert found.mass[0][0] == first + second
