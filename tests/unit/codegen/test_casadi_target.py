"""The folder for users of CasADi: it passes its own test, notices what is wrong, and is always the same."""

import os
import re
import shutil
import sys

import casadi as ca
import numpy as np
import pytest

from symid.codegen import generation
from symid.codegen.generation import run_selftest
from symid.codegen.library import import_generated_module, load_library
from symid.codegen.python_targets import generate_casadi_target
from symid.codegen.source_folder import read_manifest, write_sources
from symid.errors import GenerationError
from tests.builds import build_shipped, list_failed, make, run
from tests.refusals import raises

# Of a large robot, functions of each kind: with a Jacobian and without, vectors and matrices.
FEW = ("forward_kinematics", "inverse_dynamics", "torque_regressor")
ROBOTS = {"two_link": (), "two_link_elastic": (), "panda": FEW}


def ignore(_):
    """Take no notice of progress."""


@pytest.fixture(scope="module")
def sources():
    return {name: generate_casadi_target(build_shipped(name, *names)) for name, names in ROBOTS.items()}


@pytest.fixture(scope="module")
def folders(sources, tmp_path_factory):
    root = tmp_path_factory.mktemp("casadi")
    for name, files in sources.items():
        write_sources(files, root / name)
    return root


@pytest.fixture(scope="module")
def built(folders, c_compiler):
    make(folders / "two_link_elastic", c_compiler, flags="-O1")
    return folders / "two_link_elastic"


@pytest.fixture
def copy(built, tmp_path):
    return shutil.copytree(built, tmp_path / "code")


def run_script(folder):
    (script,) = folder.glob("*_casadi.py")
    done = run(folder, sys.executable, script.name, check=False)
    assert (done.stderr, done.returncode != 0) == ("", bool(list_failed(done)))
    return done


@pytest.mark.parametrize("name", ROBOTS)
def test_a_folder_passes_its_test_and_lists_its_files(sources, folders, c_compiler, name):
    tested = run_selftest(sources[name], folders / name, "casadi", "", ignore)
    assert tested.selftest == "passed"
    assert re.match(r"CasADi \d+\.\d+", tested.runner)
    manifest = read_manifest(folders / name)
    assert manifest["target"] == "casadi"
    assert {f"{entry['name']}.casadi" for entry in manifest["card"]["functions"]} <= set(manifest["files"])


def test_without_a_compiler_the_files_are_tested(sources, folders, monkeypatch):
    monkeypatch.setattr(generation, "locate_compiler", lambda: None)
    tested = run_selftest(sources["two_link"], folders / "two_link", "casadi", "", ignore)
    assert (tested.selftest, tested.flags) == ("passed", "")
    assert "," not in tested.runner


def test_every_function_is_compared_in_all_its_forms(built):
    lines = run_script(built).stdout.splitlines()
    assert lines[-1] == "0 of 22 functions failed"
    assert sum("file " in line and "compiled " in line for line in lines) == 22
    assert sum("jacobian " in line for line in lines) == 12


SPOILT = {
    "a sum": ("casadi.c", r"(?s)(/\* gravity:.*?res\[0\]\[0\]=)", r"\g<1>1.0+", ["gravity"]),
    "a derivative": (
        "casadi_jacobians.c",
        r"(?s)(/\* jac_hysteresis_step:.*?res\[0\]\[0\]=)",
        r"\g<1>1.0+",
        ["hysteresis_step"],
    ),
}


@pytest.mark.parametrize("spoilt", SPOILT)
def test_spoilt_c_fails_the_test(copy, c_compiler, spoilt):
    end, pattern, change, expected = SPOILT[spoilt]
    path = copy / f"symid_two_link_elastic_{end}"
    text, changed = re.subn(pattern, change, path.read_text(), count=1)
    assert changed
    path.write_text(text)
    make(copy, c_compiler, flags="-O1")
    assert list_failed(run_script(copy)) == expected


def test_a_file_of_another_function_fails_the_test(copy):
    # Of the same inputs and outputs, so that only the numbers tell.
    shutil.copy(copy / "momentum_regressor.casadi", copy / "lagrange_regressor.casadi")
    assert list_failed(run_script(copy)) == ["lagrange_regressor"]


def test_same_bytes_whatever_the_hash_seed_and_the_folder(project, tmp_path):
    script = (
        "import sys, hashlib; from pathlib import Path\n"
        "from symid.codegen.casadi_functions import build_functions\n"
        "from symid.codegen.python_targets import generate_casadi_target\n"
        "from symid.robot.toml_reader import read_robot\n"
        "made = generate_casadi_target(build_functions(read_robot(Path(sys.argv[1]))))\n"
        "texts = [text for pair in (*made.files, ('m', made.manifest)) for text in pair]\n"
        "print(hashlib.sha256('|'.join(texts).encode()).hexdigest())\n"
        "assert not any(str(Path.cwd()) in text for text in texts)\n"
    )
    command = (sys.executable, "-c", script, str(project / "robots" / "two_link_elastic.toml"))
    found = set()
    for seed in ("1", "2"):
        folder = tmp_path / seed
        folder.mkdir()
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(project)}
        found.add(run(folder, *command, env=environment).stdout)
    assert len(found) == 1


@pytest.fixture(scope="module")
def loader(built):
    return import_generated_module(built / "symid_two_link_elastic_casadi.py")


def test_the_loader_says_what_goes_in_and_out(loader):
    assert len(loader.FUNCTIONS) == 22
    for name, entry in loader.FUNCTIONS.items():
        for function in (loader.load(name), loader.load_external(name)):
            inputs = [(function.name_in(k), function.size_in(k)) for k in range(function.n_in())]
            outputs = [(function.name_out(k), function.size_out(k)) for k in range(function.n_out())]
            assert inputs == [line[:2] for line in entry["inputs"]]
            assert outputs == [line[:2] for line in entry["outputs"]]
    assert loader.FUNCTIONS["gravity"]["inputs"][0] == ("q", (2, 1), "rad", "joint coordinates")
    assert loader.FUNCTIONS["inverse_dynamics"]["jacobian"]


def test_the_loader_says_what_is_not_there(loader, folders, tmp_path):
    with pytest.raises(KeyError, match="there is no function 'weight'; there are forward_kinematics"):
        loader.load("weight")
    with pytest.raises(FileNotFoundError, match="make shared"):
        loader.load_external("gravity", tmp_path / "none.so")


def test_an_external_function_has_derivatives(loader):
    inputs = q, _, _ = ca.MX.sym("q", 2), ca.MX.sym("dq", 2), ca.MX.sym("beta", 6)
    compiled, wanted = (
        ca.Function("J", inputs, [ca.jacobian(f(*inputs), q)])
        for f in (loader.load_external("bias"), loader.load("bias"))
    )
    at = (np.array([0.3, -1.0]), np.array([2.0, 1.0]), np.arange(1.0, 7.0))
    np.testing.assert_allclose(np.array(compiled(*at)), np.array(wanted(*at)), rtol=1e-13)
    assert np.abs(np.array(wanted(*at))).max() > 1.0


def test_a_folder_that_is_not_compiled_serves_and_says_so(folders, tmp_path):
    folder = shutil.copytree(folders / "panda", tmp_path / "code", ignore=shutil.ignore_patterns("*.so"))
    library = load_library(folder)
    (notice,) = library.notices
    assert (library.backend, notice.code) == ("casadi", "codegen.casadi-machine")
    assert "`make shared`" in notice.text
    rotations, _ = library.evaluate("forward_kinematics", np.full(7, 0.1))
    # By rows: the axis of the first joint is the base's z axis.
    turned = [[np.cos(0.1), -np.sin(0.1), 0.0], [np.sin(0.1), np.cos(0.1), 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(rotations[0], turned, atol=1e-15)
    # A file that CasADi cannot read is named.
    path = folder / "inverse_dynamics.casadi"
    path.write_text(path.read_text()[:1000])
    with raises(GenerationError, "codegen.cannot-load", match=r"CasADi \d") as caught:
        load_library(folder)
    assert caught.value.notices[0].file == str(path)
