"""Signatures of models: those of earlier robot files and fits stay what they were."""

import dataclasses

import pytest

from symid.codegen.casadi_functions import build_functions
from symid.joint_models import FrictionValues
from symid.robot.toml_reader import parse_robot
from tests.chains import build_chain
from tests.friction_forms import EVERY_LAW, OLD_NAMES, give_shape

ROBOT = """
name = "two"
convention = "modified"
gravity = [0, 0, -9.81]

[[joint]]
name = "a"
kind = "revolute"
alpha = "pi/2"
drive = {{ rotor_inertia = "unknown" }}

[joint.friction]
model = "{model}"
{shape}

[[joint]]
name = "b"
kind = "prismatic"
alpha = "pi/2"

[joint.friction]
model = "{model}"
{shape}
{smoothing}

[[coupling]]
name = "m"
terms = {{ a = 1, b = 2 }}

[coupling.friction]
model = "{model}"
{shape}
"""
SHAPES = {
    "stribeck": "vs = 0.1",
    "stribeck_offset": "vs = 0.1",
    "improved_stribeck": "vs = 0.1\ndq0 = 0.02",
    "asymmetric_stribeck": "vs = 0.1",
    "stribeck_cubic": "vs = 0.1",
    "power_law": "delta = 0.5",
    "makkar": "g2 = 9\ng3 = 2\ng5 = 7",
}
SIGNATURES = """
none - ce7a93107d9b -
viscous_coulomb - a748f1530351 0b6e702c97f8
viscous_coulomb_offset - 8c80037166c2 903e55991995
asymmetric - 2b45d246e3b8 dffb430cf866
stribeck - ef7aed63d4b3 4097af22d2c6
stribeck 2 ef7aed63d4b3 4097af22d2c6
stribeck 1 f570223a2db8 b442585abbe4
stribeck 1.6 8a464a5efffa 91242867df65
stribeck_offset - 3fb86ecd1687 10eb9faef5b0
stribeck_offset 2 3fb86ecd1687 10eb9faef5b0
stribeck_offset 1 55c2fe72fc9c d1226900c1e9
stribeck_offset 1.6 ee02613c4efb 03df25843206
improved_stribeck - 1905a788f30e -
improved_stribeck 2 1905a788f30e -
improved_stribeck 1 bb3de01cc4e9 -
improved_stribeck 1.6 dd1859665195 -
asymmetric_stribeck - 5b9381f98a8e cfaf0c20ade6
asymmetric_stribeck 2 5b9381f98a8e cfaf0c20ade6
asymmetric_stribeck 1 c6e6ed35d053 97407002f19e
asymmetric_stribeck 1.6 92bf2b376af8 28e39e215b5d
cubic - d4a8fd32d3ce 7dc05a61f351
stribeck_cubic - befffccc2df4 8526ecb0c390
stribeck_cubic 2 befffccc2df4 8526ecb0c390
stribeck_cubic 1 84212f97ab3f 104c1dabc5a5
stribeck_cubic 1.6 621cabfce187 5f5860e78329
power_law - 5c9660c5ecc3 cbaddbfd9374
makkar - e658c4607f4a -
"""
"""Model, exponent, the signature that commit b57a687 gave, and that with the second joint smoothed."""
ROWS = [line.split() for line in SIGNATURES.split("\n") if line]


def sign(model, gamma="", *, smoothed=False):
    shape = SHAPES.get(model, "") + (f"\ngamma = {gamma}" if gamma else "")
    smoothing = "smoothing = 0.01" if smoothed else ""
    robot = parse_robot(ROBOT.format(model=model, shape=shape, smoothing=smoothing))
    return build_functions(robot, names=("mass_matrix",)).card.signature


def test_every_earlier_model_has_its_signature_here():
    assert {model for model, *_ in ROWS} == {*OLD_NAMES, "none"}


@pytest.mark.parametrize(("model", "gamma", "plain", "smoothed"), ROWS)
def test_signatures_of_earlier_models_stay(model, gamma, plain, smoothed):
    exponent = gamma.removeprefix("-")
    assert sign(model, exponent).startswith(plain)
    assert smoothed == "-" or sign(model, exponent, smoothed=True).startswith(smoothed)


@pytest.mark.parametrize("name", OLD_NAMES)
def test_the_name_of_today_gives_the_same_signature(name):
    shape = SHAPES.get(name, "")
    robots = [
        parse_robot(ROBOT.format(model=model, shape=shape, smoothing="")) for model in (name, OLD_NAMES[name])
    ]
    cards = [build_functions(robot, names=("mass_matrix",)).card for robot in robots]
    assert cards[0] == cards[1]
    assert {joint.friction for joint in cards[0].joints} == {OLD_NAMES[name]}


def test_models_of_two_laws_have_two_signatures():
    signatures = set()
    for name in ("none", *EVERY_LAW):
        robot = build_chain([(0.0, 0, 0, "q")])
        shape = () if name == "none" else give_shape(name)
        joint = dataclasses.replace(robot.joints[0], friction=FrictionValues(law=name, shape=shape))
        built = build_functions(dataclasses.replace(robot, joints=(joint,)), names=("mass_matrix",))
        signatures.add(built.card.signature)
    assert len(signatures) == len(EVERY_LAW) + 1
