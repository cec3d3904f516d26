"""Rows of both conventions against products of elementary matrices in floating point."""

import math

import numpy as np
from hypothesis import given, strategies as st

from symid.robot.toml_reader import parse_robot
from tests.chains import to_matrix

ANGLES = st.one_of(
    st.integers(-24, 24).map(lambda k: (f'"{k}*pi/12"' if k >= 0 else f'"-{-k}*pi/12"', k * math.pi / 12)),
    # Away from multiples of pi/2, which would be snapped.
    st.floats(-1.4, 1.4).filter(lambda x: abs(x) > 1e-3).map(lambda x: (repr(x), x)),
)
LENGTHS = st.decimals(-2, 2, places=4).map(lambda x: (str(x), float(x)))
KINDS = st.sampled_from(["revolute", "prismatic"])
ROWS = st.tuples(KINDS, ANGLES, LENGTHS, LENGTHS, ANGLES)
CHAINS = st.lists(ROWS, min_size=1, max_size=5)
SEEDS = st.integers(0, 2**32 - 1)


def turn_x(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def turn_z(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def move(x, z):
    matrix = np.eye(4)
    matrix[0, 3], matrix[2, 3] = x, z
    return matrix


def write_robot(convention, chain, extra=""):
    text = f'convention = "{convention}"\ngravity = [0, 0, -9.81]\n'
    for kind, alpha, a, d, theta in chain:
        text += f'[[joint]]\nkind = "{kind}"\nalpha = {alpha[0]}\na = {a[0]}\n'
        text += f"d = {d[0]}\ntheta = {theta[0]}\n{extra}"
    return text


def find_coordinates(row, q):
    """Return alpha, a, d, theta of a row with the joint moved by q."""
    kind, alpha, a, d, theta = row
    turned = theta[1] + (q if kind == "revolute" else 0)
    return alpha[1], a[1], d[1] + (q if kind == "prismatic" else 0), turned


@given(CHAINS, SEEDS, st.booleans())
def test_rows_and_the_tip_give_the_product_of_their_matrices(chain, seed, standard):
    robot = parse_robot(write_robot("standard" if standard else "modified", chain))
    coordinates = np.random.default_rng(seed).uniform(-3, 3, len(chain))
    expected = found = np.eye(4)
    for joint, row, q in zip(robot.joints, chain, coordinates, strict=True):
        alpha, a, d, theta = find_coordinates(row, q)
        before, after = move(a, 0) @ turn_x(alpha), turn_z(theta) @ move(0, d)
        expected = expected @ (after @ before if standard else before @ after)
        motion = turn_z(q) if row[0] == "revolute" else move(0, q)
        found = found @ to_matrix(joint.placement) @ motion
    np.testing.assert_allclose(found @ to_matrix(robot.joints[-1].frame), expected, atol=1e-12)


@given(ROWS, SEEDS)
def test_both_forms_of_a_link_in_its_standard_frame_are_the_sums_over_its_points(row, seed):
    rng = np.random.default_rng(seed)
    masses, points = rng.uniform(0.1, 2, 6), rng.uniform(-0.5, 0.5, (6, 3))
    com = masses @ points / masses.sum()
    about, whole = find_parameters(masses, points - com)[:6], find_parameters(masses, points)
    com = ", ".join(repr(float(value)) for value in com)
    central = f"mass = {float(masses.sum())!r}\ncom = [{com}]\ninertia = {{ {list_values('xyz', about)} }}\n"
    forms = (central, f"standard = {{ {list_values('XYZ', whole)} }}\n")
    texts = [write_robot("standard", [row], f"[joint.link]\n{form}") for form in forms]
    bodies = [parse_robot(text).joints[0].inertial for text in texts]
    # The points of the body seen from the joint's own frame, by matrices.
    far_end = move(row[2][1], 0) @ turn_x(row[1][1])
    moved = points @ far_end[:3, :3].T + far_end[:3, 3]
    for body in bodies:
        np.testing.assert_allclose(body, find_parameters(masses, moved), atol=1e-12)


def find_parameters(masses, points):
    """Return the ten parameters of point masses, by their definition as sums."""
    tensor = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    return [*tensor[0], *tensor[1, 1:], tensor[2, 2], *(masses @ points), masses.sum()]


def list_values(letters, values):
    """Return the entries of a tensor, and of moments and mass, as a table has them."""
    x, y, z = letters
    names = (x + x, x + y, x + z, y + y, y + z, z + z, "MX", "MY", "MZ", "M")
    return ", ".join(f"{name} = {float(value)!r}" for name, value in zip(names, values, strict=False))
