"""The page for newcomers: its commands run, print what it says, and find the robot behind its logs."""

import json
import re
import shutil

import numpy as np
import pytest
from scipy.signal import butter, cheby1, sosfiltfilt

from symid.dynamics.base_parameters import compute_parameter_values, derive_base_parameters
from symid.logs.files import RawLog
from symid.logs.headings import read_headings
from symid.robot.toml_reader import parse_robot
from tests.transcripts import compare, list_steps, run_step

TRUTH = """
name = "arm"
convention = "origin"
gravity = [0, 0, -9.81]

[[joint]]
name = "waist"
kind = "revolute"
origin = { xyz = [0, 0, 0.32] }
frame = { xyz = [0, 0, -0.18] }
drive = { gear = 100, rotor_inertia = 2.4e-5, rotor_inertia_side = "motor" }
friction = { model = "coulomb-viscous-offset", Fv = 4.2, Fc = 3.1, offset = 0.15 }
limits = { position = [-2.9671, 2.9671], velocity = 2.618, torque = 110 }
[joint.link]
mass = 6.1
com = [0.004, 0.014, 0.1]
inertia = { xx = 0.034, yy = 0.031, yz = -0.0026, zz = 0.0228 }

[[joint]]
name = "shoulder"
kind = "revolute"
origin = { xyz = [0, 0, 0.18], rpy = ["-pi/2", 0, 0] }
drive = { gear = 100, rotor_inertia = 2.4e-5, rotor_inertia_side = "motor" }
friction = { model = "coulomb-viscous-offset", Fv = 5.1, Fc = 3.8, offset = -0.4 }
limits = { position = [-2.0944, 2.0944], velocity = 2.618, torque = 110 }
[joint.link]
mass = 4.9
com = [0.171, 0.006, 0.026]
inertia = { xx = 0.012, xz = -0.0023, yy = 0.067, zz = 0.0641 }

[[joint]]
name = "elbow"
kind = "revolute"
origin = { xyz = [0.35, 0, 0] }
drive = { gear = 80, rotor_inertia = 9e-6, rotor_inertia_side = "motor" }
friction = { model = "coulomb-viscous-offset", Fv = 1.6, Fc = 1.9, offset = 0.1 }
limits = { position = [-2.618, 2.618], velocity = 3.1416, torque = 48 }
[joint.link]
mass = 2.65
com = [0.135, 0.009, 0.004]
inertia = { xx = 0.0041, xy = 0.0007, yy = 0.0271, zz = 0.0278 }
"""
"""The robot that the logs of the page were simulated with."""

FILES = ("arm.urdf", "training.csv", "validation.csv")
JOINTS = ("waist", "shoulder", "elbow")
TORQUE_PER_AMPERE = np.array([0.11 * 100, 0.11 * 100, 0.062 * 80])
PASSED = 0.4
"""Of the rate of the rows that decimation keeps: what it lets pass."""


@pytest.fixture(scope="module")
def page(project):
    return (project / "docs" / "own_robot.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def walk(page, project, tmp_path_factory, c_compiler):
    """Return a folder in which all commands of the page ran, and what each printed."""
    assert c_compiler
    folder = tmp_path_factory.mktemp("own-robot")
    for name in FILES:
        shutil.copy(project / "docs" / "own_robot" / name, folder / name)
    cache = tmp_path_factory.mktemp("cache")
    return folder, [(answer, *run_step(command, folder, cache)) for command, answer in list_steps(page)]


def test_five_commands_are_enough(page, walk):
    assert len(list_steps(page)) == page.count("```sh") == 5
    _, steps = walk
    assert [code for _, code, _ in steps] == [0] * 5


def test_the_page_shows_what_is_printed(walk):
    _, steps = walk
    for said, _, found in steps:
        assert not compare(said, found), found


def test_the_table_of_words_is_that_of_the_reader(page):
    quantities = {
        "the time": "time",
        "a position": "position",
        "a velocity": "velocity",
        "a torque": "torque",
    }
    for words, meaning in re.findall(r"^\| (`[a-z].*?`) \| (.*?) \|$", page, re.MULTILINE):
        for word in re.findall(r"`(\w+)`", words):
            name = f"{word} 1" if meaning != "the time" else word
            raw = RawLog(columns={name: np.zeros(2)}, units={name: "rad"} if meaning.startswith("no") else {})
            (found,) = read_headings(raw, ())
            assert found.commanded == meaning.startswith("not measured"), word
            if meaning.startswith("no"):
                assert (found.quantity, found.words) == ("position", ("1",)), word
            else:
                assert found.quantity == quantities[meaning.partition(",")[0]], word


def find_truth():
    robot = parse_robot(TRUTH)
    return compute_parameter_values(robot, derive_base_parameters(robot))


def test_the_truth_is_found(walk):
    folder, _ = walk
    estimate = json.loads((folder / "estimate.json").read_text(encoding="utf-8"))
    truth = find_truth()
    assert {entry["name"] for entry in estimate["parameters"]} == set(truth)
    scores = [(entry["value"] - truth[entry["name"]]) / entry["std"] for entry in estimate["parameters"]]
    assert max(map(abs, scores)) < 4.0
    # Deviations that are far too large would pass the line above.
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.5


def differentiate(values, step):
    """Return the derivative of order four of `values` (N, n), but for the ends."""
    found = np.gradient(values, step, axis=0)
    inner = 8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])
    found[2:-2] = inner / (12.0 * step)
    return found


def read_states(path, cutoff, factor):
    """Return positions, velocities, accelerations, torques in SI units, and the low-pass of decimation.

    Positions pass a low-pass at `cutoff` in Hz before they are differentiated.
    """
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    step = table[1, 0] - table[0, 0]
    position, torque = np.radians(table[:, 1:4]), table[:, 4:7] * TORQUE_PER_AMPERE
    sections = cheby1(8, 0.05, PASSED / step / factor, fs=1.0 / step, output="sos")
    low = butter(4, cutoff, fs=1.0 / step, output="sos")
    position = sosfiltfilt(low, position, axis=0, padlen=12)
    velocity = differentiate(position, step)
    acceleration = differentiate(velocity, step)
    return position, velocity, acceleration, torque, lambda values: sosfiltfilt(sections, values, padlen=24)


def read_rest(folder):
    """Return from the estimate what the URDF has no words for: offsets, and rotors that stand alone."""
    found = json.loads((folder / "estimate.json").read_text(encoding="utf-8"))["parameters"]
    values = {entry["name"]: entry["value"] for entry in found}
    numbers = range(1, len(JOINTS) + 1)
    return (np.array([values.get(f"{name}{number}", 0.0) for number in numbers]) for name in ("offset", "IA"))


def test_pinocchio_foretells_the_other_motion_as_validate_says(walk):
    pin = pytest.importorskip("pinocchio")
    folder, steps = walk
    model = pin.buildModelFromUrdf(str(folder / "arm_identified.urdf"))
    data = model.createData()
    offset, rotor = read_rest(folder)
    assert np.flatnonzero(rotor).tolist() == [2]
    viscous, dry = model.damping, model.upperDryFrictionLimit
    used = json.loads((folder / "estimate.json").read_text(encoding="utf-8"))["settings"]["processing"]
    cutoff, factor = used["filter_cutoff"], used["decimation"]["factor"]
    assert f"low-pass at {cutoff:g} Hz; decimation by {factor} " in steps[3][2]
    position, velocity, acceleration, torque, smooth = read_states(folder / "validation.csv", cutoff, factor)
    rigid = np.array(
        [pin.rnea(model, data, *state) for state in zip(position, velocity, acceleration, strict=True)]
    )
    predicted = rigid + rotor * acceleration + viscous * velocity + dry * np.sign(velocity) + offset
    inside = slice(used["drop_first"], -used["drop_last"])
    (band,) = re.findall(r"within (\S+) Hz", steps[3][2])
    table = np.loadtxt(folder / "validation.csv", delimiter=",", skiprows=1)
    scoring = butter(4, float(band), fs=1.0 / (table[1, 0] - table[0, 0]) / factor, output="sos")
    for number, joint in enumerate(JOINTS):
        # The low-pass feels the ends: they are cut before decimation, which keeps the last sample.
        foretold, measured = (smooth(values[inside, number]) for values in (predicted, torque))
        first = (len(measured) - 1) % factor
        (all_rows,) = re.findall(rf"{joint} (\S+) %", steps[3][2])
        error, whole = (measured - foretold)[first::factor], measured[first::factor]
        assert 100.0 * np.linalg.norm(error) / np.linalg.norm(whole) == pytest.approx(
            float(all_rows), rel=0.02
        )
        error, whole = (sosfiltfilt(scoring, values, padlen=12) for values in (error, whole))
        cut = int(np.ceil(0.05 * (len(whole) - 1)))
        kept = slice(cut, -cut)
        relative = 100.0 * np.linalg.norm(error[kept]) / np.linalg.norm(whole[kept])
        (said,) = re.findall(rf"^{joint} +\S+ +(\S+) +\S+ +N m +\d", steps[3][2], re.MULTILINE)
        assert relative == pytest.approx(float(said), rel=0.02)
