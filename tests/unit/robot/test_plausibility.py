"""Slips in masses and inertias of a URDF: which are seen and named; sound robots stay quiet."""

from collections import Counter

import numpy as np
import pytest

from symid.robot.mjcf_reader import parse_xml_robot
from symid.robot.toml_reader import parse_robot
from symid.robot.toml_writer import write_robot

CODES = {"robot.implausible-body", "robot.impossible-inertia", "robot.long-length"}
KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def draw_arm(rng):
    """Return mass, centre of mass, central tensor (6,) and length of each link: bars turned a little."""
    links = []
    for _ in range(int(rng.integers(3, 7))):
        length, width, mass = rng.uniform(0.15, 0.6), rng.uniform(0.03, 0.1), rng.uniform(0.3, 8)
        com = np.array([length * rng.uniform(0.35, 0.6), *rng.uniform(-0.01, 0.01, 2)])
        size = np.array([length, width, width * rng.uniform(0.6, 1.4)]) ** 2
        turn, _ = np.linalg.qr(np.eye(3) + 0.15 * rng.normal(size=(3, 3)))
        tensor = turn @ np.diag(mass / 12 * (size.sum() - size)) @ turn.T
        links.append([mass, com, tensor[np.triu_indices(3)], length])
    return links


def write_arm(links):
    lines = ['<robot name="arm"><link name="base"/>']
    for k, (mass, com, tensor, _) in enumerate(links):
        along = links[k - 1][3] if k else 0.1
        before = f"l{k - 1}" if k else "base"
        entries = " ".join(f'{key}="{value:.9g}"' for key, value in zip(KEYS, tensor, strict=True))
        lines.append(
            f'<link name="l{k}"><inertial><origin xyz="{" ".join(f"{x:.6g}" for x in com)}"/>'
            f'<mass value="{mass:.6g}"/><inertia {entries}/></inertial></link>'
            f'<joint name="j{k}" type="revolute"><parent link="{before}"/><child link="l{k}"/>'
            f'<origin xyz="{along:.4g} 0 0" '
            f'rpy="{0.7 * k} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-2" upper="2" effort="9" velocity="9"/></joint>'
        )
    return "\n".join([*lines, "</robot>"])


def shift(link, sign):
    mass, com, tensor, length = link
    added = mass * (com @ com * np.eye(3) - np.outer(com, com))
    return [mass, com, tensor + sign * added[np.triu_indices(3)], length]


def scale(factor_of_mass, factor_of_inertia):
    return lambda link, _: [link[0] * factor_of_mass, link[1], link[2] * factor_of_inertia, link[3]]


def reorder(order):
    return lambda link, _: [link[0], link[1], link[2][list(order)], link[3]]


def turn_sign(link, rng):
    signs = np.ones(6)
    signs[rng.choice([0, 3, 5])] = -1
    return [link[0], link[1], link[2] * signs, link[3]]


def flip_product(link, rng):
    signs = np.ones(6)
    signs[rng.choice([1, 2, 4])] = -1
    return [link[0], link[1], link[2] * signs, link[3]]


def use_millimetres(link, _):
    return [link[0], link[1] * 1000, link[2], link[3] * 1000]


# What is done to links, whether to all, the words that name it, and the least share in which it is seen and
# named. Signs of products of inertia rarely leave an impossible body: nothing shows them.
SLIPS = {
    "masses in g": (scale(1e3, 1), True, "masses are in g", 1.0, 1.0),
    "mass of one link in g": (scale(1e3, 1), False, "not grams", 0.9, 0.9),
    "inertias in g mm^2": (scale(1, 1e9), True, "in g mm^2", 1.0, 0.9),
    "inertias in kg mm^2": (scale(1, 1e6), False, "kg mm^2", 1.0, 0.9),
    "g and g mm^2": (scale(1e3, 1e9), True, "g mm^2 beside masses in g", 1.0, 0.9),
    "lengths in mm": (use_millimetres, True, "lengths in m", 1.0, 1.0),
    "diagonal first": (reorder((0, 3, 5, 1, 2, 4)), True, "in the order xx yy zz xy xz yz", 1.0, 0.9),
    "row by row below the diagonal": (reorder((0, 1, 3, 2, 4, 5)), True, "in the order xx xy yy", 0.9, 0.8),
    "a minus before a moment": (turn_sign, False, "without the minus", 1.0, 1.0),
    "parallel axis subtracted twice": (lambda link, _: shift(link, -1), True, "subtracted twice", 1.0, 0.9),
    "about the link's origin": (lambda link, _: shift(link, 1), True, "about the links' origins", 0.9, 0.9),
    "sign of a product of inertia": (flip_product, False, "another sign of a product", 0.0, 0.0),
}


def list_warnings(text):
    robot = parse_xml_robot(text, "arm.urdf")
    return [entry.text for entry in robot.notices if entry.code in CODES]


@pytest.mark.parametrize("name", SLIPS)
def test_slips_are_seen_and_named(name):
    spoil, everywhere, words, seen, named = SLIPS[name]
    counts, drawn = Counter(), 17
    for seed in range(drawn):
        rng = np.random.default_rng(seed)
        links = draw_arm(rng)
        chosen = range(len(links)) if everywhere else [int(rng.integers(len(links)))]
        spoiled = [spoil(link, rng) if k in chosen else link for k, link in enumerate(links)]
        found = list_warnings(write_arm(spoiled))
        counts["seen"] += bool(found)
        counts["named"] += any(words in text for text in found)
    assert counts["seen"] >= seen * drawn
    assert counts["named"] >= named * drawn


@pytest.mark.parametrize("name", ["mass of one link in g", "masses in g", "g and g mm^2", "lengths in mm"])
def test_robot_files_are_checked_as_urdfs_are(name):
    """A TOML file of the same arm has the same doubts, each at its own line."""
    spoil, everywhere, words, *_ = SLIPS[name]
    rng = np.random.default_rng(4)
    links = draw_arm(rng)
    spoiled = [spoil(link, rng) if everywhere or k == 1 else link for k, link in enumerate(links)]
    for arm, expected in ((links, 0), (spoiled, 1)):
        text = write_robot(parse_xml_robot(write_arm(arm), "arm.urdf"))
        found = [entry for entry in parse_robot(text).notices if entry.code in CODES]
        assert any(words in entry.text for entry in found) == expected
        assert bool(found) == expected
        assert all(entry.line for entry in found)


def test_sound_arms_stay_quiet():
    assert [list_warnings(write_arm(draw_arm(np.random.default_rng(seed)))) for seed in range(60)] == [
        []
    ] * 60


@pytest.mark.parametrize(
    ("mass", "inertia", "words"),
    [
        (1e30, 1.0, "torques are too large; correct it"),
        (2e6, 1.0, "not grams"),
        (1e-5, 1.0, "radius of gyration"),
        (1e-3, 1e-3, "radius of gyration"),
        (0.2, 50.0, "radius of gyration"),
    ],
)
def test_placeholders_are_named_with_their_line(mass, inertia, words):
    links = draw_arm(np.random.default_rng(5))
    links[1] = [mass, 0 * links[1][1], inertia * np.array([1, 0, 0, 1, 0, 1]), 0.1]
    links[1:] = links[1:2]
    robot = parse_xml_robot(write_arm(links), "arm.urdf")
    (found,) = [entry for entry in robot.notices if entry.code == "robot.implausible-body"]
    assert words in found.text
    assert "link 'l1'" in found.text
    assert found.line == 3


def test_the_hobby_arm_with_a_placeholder(shared_data):
    text = (shared_data.parent / "cases" / "robots" / "placeholder_inertia.urdf").read_text()
    words = "link 'finger': inertia: a radius of gyration of 316 m"
    assert any(words in entry for entry in list_warnings(text))
