"""Scales of torques: wrong gears are told from bodies that a drawing has otherwise, and from tools."""

import numpy as np
import pytest

import symid
from symid.identification.estimators import ParameterEstimate
from symid.identification.rigid import compare_fit_scales
from symid.robot.inertia import compute_standard_parameters
from tests.unit.robot.test_plausibility import draw_arm, write_arm

DRAWN = 12


def redraw(link, rng):
    """Return a link of another mass, whose centre is elsewhere, by a quarter of its radius of gyration."""
    mass, com, tensor, length = link
    radius = np.sqrt(tensor[[0, 3, 5]].sum() / 2.0 / mass)
    moved = com + 0.25 * radius * rng.uniform(-1.0, 1.0, 3)
    factor = rng.uniform(0.75, 1.25)
    return [mass * factor, moved, tensor * factor * rng.uniform(0.8, 1.2), length]


def add_tool(link, mass, place):
    """Return a link that carries a point of `mass` (kg) at `place` (3,) in m."""
    whole, com, tensor, length = link
    parts = [
        compute_standard_parameters(whole, com, tensor),
        compute_standard_parameters(mass, place, [0] * 6),
    ]
    both = np.sum(parts, axis=0)
    centre = both[6:9] / both[9]
    shift = np.array(compute_standard_parameters(both[9], centre, [0] * 6))
    return [both[9], centre, (both - shift)[:6], length]


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """Return for each draw the functions and the robot of a file, and base parameters (b,) of true arms."""
    folder, found = tmp_path_factory.mktemp("arms"), []
    for seed in range(DRAWN):
        rng = np.random.default_rng(seed)
        drawn = draw_arm(rng)
        plain = [redraw(link, rng) for link in drawn]
        place = plain[-1][1] + rng.uniform(-0.1, 0.1, 3)
        tool = 0.3 * rng.uniform() * sum(link[0] for link in plain)
        loaded = [*plain[:-1], add_tool(plain[-1], tool, place)]
        models = []
        for name, links in (("file", drawn), ("plain", plain), ("loaded", loaded)):
            path = folder / f"{name}_{seed}.urdf"
            path.write_text(write_arm(links))
            models.append(symid.load(path, backend="python"))
        libraries = [model.context.prepare(model.description) for model in models]
        values = [np.array([entry.value for entry in one.card.beta]) for one in libraries]
        found.append((libraries[0], models[0].description, *values[1:]))
    return found


def find_beyond(library, robot, values):
    """Return the joints whose torque is said to be of another scale."""
    names = [entry.name for entry in library.card.beta]
    pairs = zip(names, values.tolist(), strict=True)
    estimates = [ParameterEstimate(name=name, value=value, std=0.0, unit="") for name, value in pairs]
    found = compare_fit_scales(library, robot, estimates, ())
    return [entry.joint for entry in found if entry.is_beyond()]


@pytest.mark.parametrize("true", ["other bodies", "a tool"])
def test_other_bodies_and_tools_are_no_wrong_gear(arms, true):
    picked = [(library, robot, values[true == "a tool"]) for library, robot, *values in arms]
    assert [find_beyond(*entry) for entry in picked] == [[]] * DRAWN


@pytest.mark.parametrize("factor", [0.01, 0.2, 6.0, 100.0])
@pytest.mark.parametrize("true", ["other bodies", "a tool"])
def test_wrong_gears_are_seen(arms, true, factor):
    seen = [
        bool(find_beyond(library, robot, factor * values[true == "a tool"]))
        for library, robot, *values in arms
    ]
    assert sum(seen) >= 0.9 * DRAWN
