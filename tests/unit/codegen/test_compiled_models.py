"""The compiled plant and branches: kept under their keys, made again when damaged, told where they stand."""

import numpy as np
import pytest

from symid.codegen import cache, compiled_models
from symid.codegen.cache import prepare_library
from symid.codegen.compiled_models import PlantExperiment, PlantRobot, load_plant_code, run_compiled_branch
from symid.errors import GenerationError
from symid.joint_models import Relays, SlipSpring, run_branch, run_element, strip_branch
from symid.robot import load_robot
from tests.builds import run
from tests.elements import ELEMENTS
from tests.refusals import raises


def compile_nothing(*arguments):
    arguments[-1].write_bytes(b"no")


def is_stepped(branch):
    return not isinstance(branch, Relays | SlipSpring)


def test_the_plant_is_made_once(tmp_path, c_compiler, monkeypatch):
    assert load_plant_code(cache=tmp_path).notices == ()
    (made,) = tmp_path.glob("plant-*")
    monkeypatch.setattr(compiled_models, "compile_sources", None)
    assert load_plant_code(cache=tmp_path).notices == ()
    assert list(tmp_path.iterdir()) == [made]


def test_a_plant_that_does_not_load_is_an_error_and_none_without_a_compiler(
    tmp_path, c_compiler, monkeypatch
):
    assert load_plant_code(compiler="no-such-compiler", cache=tmp_path) is None
    monkeypatch.setattr(compiled_models, "compile_sources", compile_nothing)
    with raises(GenerationError, "codegen.cannot-load"):
        load_plant_code(cache=tmp_path)


def test_the_source_compiles_without_a_warning(project, tmp_path, c_compiler):
    flags = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-O2", "-c")
    run(tmp_path, c_compiler, *flags, project / "templates" / "c" / "elastic_plant.c", "-o", "plant.o")


def test_functions_without_addresses_are_refused(tmp_path, c_compiler):
    library = prepare_library(load_robot("two_link"), names=("gravity",), cache=tmp_path, backend="python")
    one, none = np.ones(1), np.zeros((1, 0))
    ones = dict.fromkeys(("beta", "rotor", "stiffness", "cubic", "damping"), one)
    nones = dict.fromkeys(("radius", "weight", "knee", "slope"), none)
    robot = PlantRobot(friction=np.zeros(0), **ones, **nones)
    tracks = dict.fromkeys(("angle", "speed", "torque"), np.zeros((3, 1)))
    ones = dict.fromkeys(("stiffness", "damping", "limit", "step", "q", "theta"), one)
    order = PlantExperiment(period=1e-3, substeps=1, parts=1, play=none, **tracks, **ones)
    assert (robot.size, order.ticks) == (1, 3)
    with raises(GenerationError, "codegen.no-address"):
        load_plant_code(cache=tmp_path).run(library, robot, order)


STEPPED = sorted(name for name, element in ELEMENTS.items() if any(is_stepped(b) for b in element.branches))


@pytest.mark.parametrize("name", STEPPED)
def test_a_compiled_branch_has_the_bytes_of_the_virtual_machine(name, c_compiler):
    element, rng = ELEMENTS[name], np.random.default_rng(3)
    x, t = np.cumsum(rng.normal(size=700)) * 0.02, np.cumsum(rng.uniform(0.5, 1.5, 700)) * 1e-2
    compiled_models._load_branch.cache_clear()
    assert all(compiled_models._load_branch(strip_branch(b)) for b in element.branches if is_stepped(b))
    plain, compiled = (run_element(element, x, t, runner=runner) for runner in (None, run_compiled_branch))
    np.testing.assert_array_equal(compiled.output, plain.output)
    np.testing.assert_array_equal(compiled.stored, plain.stored)
    assert compiled.states == plain.states
    assert np.ptp(plain.output) > 0.0


@pytest.mark.parametrize("fault", ["no compiler", "no place", "no code"])
def test_without_compiled_code_the_virtual_machine_steps(fault, tmp_path, monkeypatch):
    (branch,) = ELEMENTS["bouc-wen"].branches
    x = 0.1 * np.sin(np.linspace(0.0, 9.0, 50))
    path = (x, np.diff(x, prepend=0.0), np.zeros(50), np.ones(50))
    blocked = tmp_path / "file"
    blocked.write_text("")
    if fault == "no compiler":
        monkeypatch.setattr(compiled_models, "locate_compiler", lambda: None)
    user_folder = tmp_path if fault == "no code" else blocked / "a"
    monkeypatch.setattr(cache, "locate_user_folder", lambda: user_folder)
    monkeypatch.setattr(cache, "make_temporary_folder", lambda: blocked / "b")
    monkeypatch.setattr(compiled_models, "compile_sources", compile_nothing)
    compiled_models._load_branch.cache_clear()
    assert compiled_models._load_branch(strip_branch(branch)) is None
    found = run_compiled_branch(branch, path, np.zeros(1))
    compiled_models._load_branch.cache_clear()
    np.testing.assert_array_equal(found, run_branch(branch, path, np.zeros(1)))


def test_as_many_states_are_written_as_a_branch_has(c_compiler):
    (branch,) = ELEMENTS["attracted"].branches
    path = tuple(np.ones(9) for _ in range(4))
    one, four = (run_compiled_branch(branch, path, np.zeros(count)) for count in (1, 4))
    np.testing.assert_array_equal(one, four)
    with pytest.raises(ValueError, match="broadcast"):
        run_compiled_branch(branch, path, np.zeros(3))
    with pytest.raises(ValueError, match="unpack"):
        run_compiled_branch(branch, path[:3], np.zeros(4))
