"""Matrices A of standard Denavit-Hartenberg rows in lessons, against those of books, symbol by symbol.

Sources:
    Siciliano, Sciavicco, Villani, Oriolo 2009, Robotics, eq. (2.52): A of a row; sec. 2.9.1 and 2.9.2: planar
    arm with three joints, spherical arm.
    Spong, Hutchinson, Vidyasagar 2006, Robot Modeling and Control, eq. (3.10) and ex. 3.1: A of a row, two
    links.
    Craig 2005, sec. 3.4: modified rows, which have no such matrices.
"""

import pytest

from symid.lessons import get_book
from symid.lessons.chapters import list_items
from symid.lessons.dynamic_chapters import build_lesson
from symid.lessons.matrices import derive_standard_transforms
from symid.robot import load_robot
from symid.robot.toml_reader import parse_robot

HEAD = 'name = "arm"\nconvention = "{}"\ngravity = [0, -9.81, 0]\n'
JOINT = '[[joint]]\nkind = "{}"\nalpha = "{}"\na = {}\nd = {}\n'


def write(convention, *rows):
    return parse_robot(HEAD.format(convention) + "".join(JOINT.format(*row) for row in rows))


def derive(robot, notation):
    """Return the letters, and the matrices (4, 4) of a lesson."""
    model = build_lesson(robot, get_book(notation)).model
    rows = [(*rotation, origin) for rotation, origin in derive_standard_transforms(model)]
    zero, one = model.algebra.zero, model.algebra.one
    last = (zero, zero, zero, one)
    found = [(*((*row, x) for row, x in zip(one_[:3], one_[3], strict=True)), last) for one_ in rows]
    return model.algebra, model.algebra.generators, found


def multiply(algebra, left, right):
    columns = list(zip(*right, strict=True))
    return [
        [algebra.reduce(sum(x * y for x, y in zip(row, col, strict=True))) for col in columns] for row in left
    ]


def assert_equal(algebra, ours, theirs):
    for mine, book in zip(ours, theirs, strict=True):
        for x, y in zip(mine, book, strict=True):
            assert algebra.reduce(algebra.one * y - x) == 0


PLANAR = write("standard", *(("revolute", "0", a, 0) for a in (0.5, 0.4, 0.3)))
SPHERICAL = write(
    "standard", ("revolute", "-pi/2", 0, 0), ("revolute", "pi/2", 0, 0.2), ("prismatic", "0", 0, 0)
)
SIX = write(
    "standard",
    ("revolute", "pi/2", 0, 0.3),
    ("revolute", "0", 0.4, 0),
    ("prismatic", "-pi/2", 0.1, 0.2),
    ("revolute", "pi", 0.3, 0.1),
)


@pytest.mark.parametrize("notation", ["siciliano", "symid"])
@pytest.mark.parametrize("robot", [PLANAR, SPHERICAL, SIX], ids=["planar", "spherical", "mixed"])
def test_each_matrix_is_the_one_of_both_books(robot, notation):
    algebra, known, found = derive(robot, notation)
    turns = {"0": (1, 0), "pi/2": (0, 1), "-pi/2": (0, -1), "pi": (-1, 0)}
    rows = {id(PLANAR): ["0"] * 3, id(SPHERICAL): ["-pi/2", "pi/2", "0"]}
    alphas = rows.get(id(robot), ["pi/2", "0", "-pi/2", "pi"])
    for k, (matrix, alpha) in enumerate(zip(found, alphas, strict=True), start=1):
        ca, sa = turns[alpha]
        s, c = (known.get(f"{x}{k}", algebra.one * (x == "c")) for x in "sc")
        a, d = (known.get(f"{x}{k}", 0) for x in "ad")
        if robot.joints[k - 1].prismatic:
            d = known.get(f"d0{k}" if notation == "siciliano" else f"d{k}", 0) + known[f"q{k}"]
        # Siciliano (2.52), Spong (3.10).
        book = ((c, -s * ca, s * sa, a * c), (s, c * ca, -c * sa, a * s), (0, sa, ca, d), (0, 0, 0, 1))
        assert_equal(algebra, matrix, book)


def test_products_are_those_of_the_arms_in_the_books():
    algebra, b, (one, two, three) = derive(PLANAR, "siciliano")
    (s1, c1), (s2, c2), (s3, c3) = ((b[f"s{k}"], b[f"c{k}"]) for k in (1, 2, 3))
    s12, c12 = s1 * c2 + c1 * s2, c1 * c2 - s1 * s2
    s123, c123 = s12 * c3 + c12 * s3, c12 * c3 - s12 * s3
    x, y = b["a1"] * c1 + b["a2"] * c12, b["a1"] * s1 + b["a2"] * s12
    flat = ((0, 0, 1, 0), (0, 0, 0, 1))
    pair = multiply(algebra, one, two)
    # Spong, example 3.1.
    assert_equal(algebra, pair, ((c12, -s12, 0, x), (s12, c12, 0, y), *flat))
    # Siciliano, section 2.9.1.
    x, y = x + b["a3"] * c123, y + b["a3"] * s123
    assert_equal(algebra, multiply(algebra, pair, three), ((c123, -s123, 0, x), (s123, c123, 0, y), *flat))
    # Siciliano, section 2.9.2.
    algebra, b, (one, two, three) = derive(SPHERICAL, "siciliano")
    (s1, c1), (s2, c2), d2, d3 = (b["s1"], b["c1"]), (b["s2"], b["c2"]), b["d2"], b["q3"]
    book = (
        (c1 * c2, -s1, c1 * s2, c1 * s2 * d3 - s1 * d2),
        (s1 * c2, c1, s1 * s2, s1 * s2 * d3 + c1 * d2),
        (-s2, 0, c2, c2 * d3),
        (0, 0, 0, 1),
    )
    assert_equal(algebra, multiply(algebra, multiply(algebra, one, two), three), book)


def test_a_modified_file_has_standard_frames_in_a_book_that_writes_them():
    modified = write(
        "modified", ("revolute", "0", 0, 0), ("revolute", "-pi/2", 0, 0.2), ("prismatic", "pi/2", 0, 0)
    )
    algebra, _, ours = derive(modified, "siciliano")
    assert_equal(algebra, ours[1], derive(SPHERICAL, "siciliano")[2][1])
    for robot, notation, shown in (
        (modified, "siciliano", "standard"),
        (modified, "symid", "modified"),
        (SPHERICAL, "symid", "standard"),
        (SPHERICAL, "craig", "modified"),
        (SPHERICAL, "khalil", "modified"),
        # A tree, and a first axis that is not the base's, have no standard rows.
        (load_robot("quadruped"), "siciliano", "modified"),
        (load_robot("stanford"), "siciliano", "standard"),
    ):
        items = list(list_items(build_lesson(robot, get_book(notation)).chapters[0].items))
        table = next(item for item in items if item.kind == "table")
        assert f"{shown} Denavit-Hartenberg" in items[0].text
        assert [row[2] for row in table.rows[1:]] == [
            "prismatic" if joint.prismatic else "revolute" for joint in robot.joints
        ]
