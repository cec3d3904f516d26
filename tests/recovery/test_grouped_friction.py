"""Simulated robots whose parameters are groups: the plant brakes as the library says, logs give it back."""

from dataclasses import replace

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.identification.rigid.fit import identify_parameters
from symid.robot.description import Processing
from symid.robot.toml_reader import read_robot
from symid.simulation.rigid_plant import RigidPlant, build_friction_lines, build_rest_state
from tests.recovery.rigid_runs import list_truth, run_fourier

HEAD = 'name = "{name}"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
LINK = "link = { mass = 2.0, com = [0.1, 0, 0.1], inertia = { xx = 0.1, yy = 0.1, zz = 0.1 } }"
BEHIND = """
[[joint]]
name = "j1"
kind = "revolute"
{link}
friction = {{ model = "{model}", {first} }}
mimic = {{ joint = "j2", multiplier = {multiplier} }}
[[joint]]
name = "j2"
kind = "revolute"
a = 0.3
{link}
friction = {{ model = "{model}", {second} }}
limits = {{ position = [-1, 1], velocity = 2, torque = 50 }}
"""
SPRUNG = """
[[joint]]
name = "j1"
kind = "revolute"
alpha = "pi/2"
{link}
spring = {{ stiffness = 20, rest = 0.1 }}
friction = {{ model = "coulomb-viscous-offset", Fv = 0.5, Fc = 0.7, offset = 0.4 }}
[[joint]]
name = "j2"
kind = "prismatic"
alpha = "-pi/2"
{link}
friction = {{ model = "coulomb-viscous-offset", Fv = 0.9, Fc = 0.6, offset = -0.3 }}
"""
UPRIGHT = """
[[joint]]
name = "slide"
kind = "prismatic"
{link}
drive = {{ gear = 1, rotor_inertia = 0.5, rotor_inertia_side = "joint" }}
friction = {{ model = "{model}", {first} }}
"""
MODELS = {
    "coulomb-viscous": ("Fv = 0.1, Fc = 0.2", "Fv = 0.3, Fc = 0.15"),
    "asymmetric": (
        "Fvp = 0.1, Fcp = 0.2, Fvn = 0.3, Fcn = 0.4",
        "Fvp = 0.5, Fcp = 0.6, Fvn = 0.2, Fcn = 0.7",
    ),
    "coulomb-viscous-offset": ("Fv = 0.1, Fc = 0.2, offset = 0.05", "Fv = 0.3, Fc = 0.15, offset = -0.02"),
}

# What the plant, the energy balance and the torque rows call; other functions need no compiler here.
CALLED = ("friction", "friction_regressor", "forward_dynamics", "mass_matrix", "bias", "energy")
FITTED = (*CALLED, "torque_regressor")


def read(tmp_path, text, name, **words):
    path = tmp_path / f"{name}.toml"
    path.write_text((HEAD + text).format(name=name, link=LINK, **words))
    return read_robot(path)


def read_behind(tmp_path, model, multiplier):
    first, second = MODELS[model]
    name = f"{model}{multiplier}".replace(".", "_").replace("-", "minus")
    return read(tmp_path, BEHIND, name, model=model, multiplier=multiplier, first=first, second=second)


def brake(library, dq):
    lines = build_friction_lines(library)
    rows, columns = np.sign(dq).astype(int), np.arange(library.card.size)
    return lines.viscous[rows, columns] * dq + lines.level[rows, columns]


def assert_brakes_as_the_library(library):
    dq = np.random.default_rng(2).uniform(-3, 3, (200, library.card.size))
    values = np.array([parameter.value for parameter in library.card.friction])
    expected = library.evaluate("friction", dq, values)[0]
    np.testing.assert_allclose([brake(library, row) for row in dq], expected, rtol=1e-12, atol=1e-13)
    return dq, expected


@pytest.mark.parametrize("multiplier", [3, -0.5])
@pytest.mark.parametrize("model", MODELS)
def test_a_plant_brakes_as_the_library_says(tmp_path, model, multiplier):
    library = prepare_library(read_behind(tmp_path, model, multiplier), names=CALLED)
    dq, friction = assert_brakes_as_the_library(library)
    plant, q = RigidPlant(library), np.array([0.3])
    for row, loss in zip(dq[:20], friction, strict=False):
        state = replace(build_rest_state(q), dq=row, modes=tuple(np.sign(row).astype(int).tolist()))
        after = plant.advance(state, np.zeros(1), 1e-9)
        free = library.evaluate("forward_dynamics", q, row, -loss, plant.beta)[0]
        np.testing.assert_allclose((after.dq - row) / 1e-9, free, rtol=1e-5, atol=1e-5)


def assert_comes_back(robot, library, tolerance):
    run = run_fourier(robot, library, 0, duration=5.0)
    # The losses, anew: friction of the library times velocity, by the trapezoidal rule.
    values = np.array([parameter.value for parameter in library.card.friction])
    (torque,) = library.evaluate("friction", run.dq, values)
    losses = np.trapezoid((torque * run.dq).sum(axis=1), run.recording.time)
    assert run.energy_gap < 1e-6
    assert abs(losses - run.dissipation[-1]) < 2e-3 * abs(run.dissipation[-1])
    processing = Processing(drop_first=50, drop_last=50, standstill=0.02)
    estimate = identify_parameters(library, [run.recording], processing, rows="torque")
    truth = list_truth(library)
    found = dict(zip(truth, estimate.assemble(tuple(truth)), strict=True))
    assert found == pytest.approx(truth, rel=0, abs=tolerance * max(map(abs, truth.values())))
    return found


def test_a_log_gives_back_the_friction_of_a_group(tmp_path):
    robot = read_behind(tmp_path, "coulomb-viscous", 3)
    library = prepare_library(robot, names=FITTED)
    # tau_f = 3 (Fv1 3 dq + Fc1 sign(3 dq)) + Fv2 dq + Fc2 sign(dq)
    for dq in (-0.7, 1.3):
        expected = (9 * 0.1 + 0.3) * dq + (3 * 0.2 + 0.15) * np.sign(dq)
        np.testing.assert_allclose(brake(library, np.array([dq])), [expected], rtol=1e-12)
    found = assert_comes_back(robot, library, 2e-3)
    np.testing.assert_allclose(found["FvR1"], 0.1 + 0.3 / 9, rtol=0.02)
    np.testing.assert_allclose(found["FcR1"], 0.2 + 0.15 / 3, rtol=0.02)


def test_an_offset_beside_a_spring_is_part_of_it(tmp_path):
    robot = read(tmp_path, SPRUNG, "sprung")
    library = prepare_library(robot, names=FITTED)
    values = {parameter.name: parameter.value for parameter in library.card.beta}
    np.testing.assert_allclose(values["KRR1"], -20 * 0.1 + 0.4)
    assert_brakes_as_the_library(library)
    found = assert_comes_back(robot, library, 2e-3)
    np.testing.assert_allclose(found["KRR1"], -1.6, rtol=0.02)


@pytest.mark.parametrize("model", ["coulomb-viscous-offset", "asymmetric"])
def test_an_offset_on_a_vertical_slide_is_part_of_its_weight(tmp_path, model):
    robot = read(tmp_path, UPRIGHT, f"upright_{model}".replace("-", "_"), model=model, first=MODELS[model][0])
    library = prepare_library(robot, names=FITTED)
    assert_brakes_as_the_library(library)
    assert_comes_back(robot, library, 2e-3)
