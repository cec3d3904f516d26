"""Generated C and Python against CasADi's own evaluation, and what the C must be besides right."""

import json
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from symid.codegen.c_library import generate_c_library
from symid.codegen.casadi_functions import Functions, build_functions
from symid.codegen.functions import JointCard, ModelCard
from symid.codegen.library import load_library
from symid.codegen.python_targets import generate_python_module
from symid.errors import GenerationError, UsageError
from symid.robot.toml_reader import parse_robot
from symid.serialization import read_record
from tests.builds import build_shipped, make, run, spoil, write_c, write_python
from tests.refusals import raises
from tests.sx_programs import make_toy

WARNINGS = "all extra pedantic conversion shadow double-promotion missing-prototypes error"
STRICT = ("-std=c99", "-O1", *(f"-W{name}" for name in WARNINGS.split()))
ROBOTS = ("two_link", "emps", "panda")
EACH_ROBOT = pytest.mark.parametrize("robot", ROBOTS)


@pytest.fixture(scope="module")
def made():
    return {name: build_shipped(name) for name in ROBOTS}


@pytest.fixture(scope="module")
def c_folders(made, tmp_path_factory, c_compiler):
    root = tmp_path_factory.mktemp("c")
    for name, functions in made.items():
        make(write_c(functions, root / name), c_compiler, "all", "shared", flags=" ".join(STRICT))
    return root


@EACH_ROBOT
def test_all_sources_compile_strictly_and_pass_the_self_test(c_folders, robot):
    # The fixture compiles with the strict flags; nothing is left out.
    folder = c_folders / robot
    built = {path.stem for path in folder.iterdir() if path.suffix in {".o", ""}}
    assert {path.stem for path in folder.glob("*.c")} <= built
    assert "FAILED" not in run(folder, "./selftest").stdout
    text = (folder / f"symid_{robot}.h").read_text()
    assert "casadi" not in text.lower()
    assert f"int symid_{robot}_mass_matrix(const double q[" in text


def test_the_examples_track_their_trajectory(c_folders, tmp_path):
    # The second reads identified parameters.
    values = tmp_path / "values.txt"
    values.write_text("95.1 203.5 20.39 -3.16\n")
    assert run(c_folders / "emps", "./control_loop", check=False).returncode == 2
    for command in (("two_link", "./control_loop"), ("emps", "./control_loop", str(values))):
        assert float(run(c_folders / command[0], *command[1:]).stdout.split()[-4]) < 5e-3


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize(
    ("robot", "names"),
    [
        ("two_link", ("inverse_dynamics", "friction")),
        ("two_link", ("forward_kinematics",)),
        ("emps", ("bias", "friction")),
        ("two_link_elastic", ("mass_matrix", "hysteresis_step")),
    ],
)
def test_the_example_of_functions_that_make_no_loop(robot, names, precision, tmp_path, c_compiler):
    """It calls each once, with given values where the robot file has none, and prints what CasADi finds."""
    functions = build_shipped(robot, *names)
    folder, card = write_c(functions, tmp_path / "c", precision=precision), functions.card
    make(folder, c_compiler, "all", flags="-O1 -Werror")
    given, found = [], {"beta": card.beta, "f": card.friction, "h": card.springs, "IA": card.rotors}
    vectors = {name: [entry.value for entry in entries] for name, entries in found.items()}
    if robot == "emps":
        assert run(folder, "./example", check=False).returncode == 2
        vectors |= {"beta": [95.1], "f": [203.5, 20.39, -3.16]}
        (tmp_path / "values").write_text("95.1 203.5 20.39 -3.16\n")
        given = [str(tmp_path / "values")]
    lines = iter(run(folder, "./example", *given).stdout.splitlines())
    for spec, function in zip(card.functions, functions.functions, strict=True):
        values = function.call([vectors.get(port.name, [0.1] * port.size) for port in spec.inputs])
        for port, value in zip(spec.outputs, values, strict=True):
            name, printed = next(lines).rsplit(":", 1)
            assert name == f"{spec.name}: {port.name}"
            wanted = np.ravel(ca.DM(value).full())
            numbers = list(map(float, printed.split()))
            np.testing.assert_allclose(numbers, wanted, rtol=1e-5, atol=1e-6)
    assert not list(lines)


@pytest.mark.parametrize("robot", ["two_link", "panda"])
def test_float_builds_agree_and_hold_no_double(made, robot, tmp_path, c_compiler):
    folder = write_c(made[robot], tmp_path / "c", precision="float")
    for source in folder.glob("symid_*.[ch]"):
        assert "double" not in source.read_text()
    done = make(folder, c_compiler, "check", "shared", flags="-O1 -Werror")
    assert "100 states, tolerance 2e-05" in done.stdout
    library = load_library(folder)
    q = np.linspace(-1, 1, 3 * library.card.size).reshape(3, -1)
    poses = library.evaluate("forward_kinematics", q)
    assert [value.dtype for value in poses] == [np.float64] * 2


def test_what_is_no_library_is_refused(made, tmp_path):
    with raises(UsageError, "usage.no-library"):
        load_library(tmp_path)
    c, python = write_c(made["emps"], tmp_path / "c"), write_python(made["emps"], tmp_path / "p")
    with raises(UsageError, "usage.not-compiled", match="`make shared`"):
        load_library(c)
    (c / "libsymid_emps.so").write_bytes(b"no library")
    with raises(GenerationError, "codegen.cannot-load", match=r"libsymid_emps\.so"):
        load_library(c)
    update = python / ".symid-update-1"
    update.mkdir()
    with raises(UsageError, "usage.interrupted-update"):
        load_library(python)
    update.rmdir()
    (python / "symid_emps.py").write_text("def (")
    with raises(GenerationError, "codegen.cannot-load", match=r"symid_emps\.py"):
        load_library(python)
    for text in ('{"symid": "0", "files": {}}', '{"symid": "0", "files": {}, "card": {"robot": 1}}'):
        (tmp_path / "manifest.json").write_text(text)
        with raises(UsageError, "usage.broken-manifest"):
            load_library(tmp_path)


def test_the_python_module_needs_numpy_alone(made, tmp_path):
    script = (
        "import runpy, sys\n"
        "sys.modules['symid'] = sys.modules['casadi'] = sys.modules['sympy'] = sys.modules['scipy'] = None\n"
        "runpy.run_path('symid_two_link.py', run_name='__main__')\n"
    )
    done = run(write_python(made["two_link"], tmp_path / "p"), sys.executable, "-c", script)
    assert "0 of 19 functions failed" in done.stdout


@pytest.fixture(scope="session")
def cmake(c_compiler):
    """Return a call of cmake in a folder, with the arguments of each of its runs."""
    found = shutil.which("cmake")
    if found is None:
        pytest.skip("wants cmake")

    def call(folder, *runs):
        for arguments in runs:
            subprocess.run([found, *arguments.split()], cwd=folder, capture_output=True, check=True)

    return call


def test_cmake_builds_and_tests_the_library(made, tmp_path, cmake):
    write_c(made["two_link"], tmp_path / "c")
    cmake(tmp_path, "-S c -B b", "--build b", "--build b --target test")
    assert "Name: symid_two_link" in (tmp_path / "b" / "symid_two_link.pc").read_text()


@pytest.fixture(scope="module")
def installed(made, tmp_path_factory, cmake):
    folder = tmp_path_factory.mktemp("installed")
    write_c(made["emps"], folder / "c")
    place = folder / "installed"
    cmake(folder, "-S c -B b -DCMAKE_UNITY_BUILD=ON", "--build b", f"--install b --prefix {place}")
    return place


def test_an_installed_library_can_be_moved(installed, tmp_path):
    shutil.copytree(installed, tmp_path / "second")
    (package,) = (tmp_path / "second").rglob("*.pc")
    lines = package.read_text().splitlines()
    prefix = lines[0].removeprefix("prefix=").replace("${pcfiledir}", str(package.parent))
    assert (tmp_path / "second").samefile(prefix)
    values = dict(line.split("=", 1) for line in lines if "=" in line and "{prefix}" in line)
    for key, name in (("libdir", "libsymid_emps.a"), ("includedir", "symid_emps.h")):
        assert (Path(values[key].replace("${prefix}", prefix)) / name).is_file()


USER = """
cmake_minimum_required(VERSION 3.13)
project(user C)
find_package(symid_emps REQUIRED)
add_executable(user main.c)
target_link_libraries(user PRIVATE symid_emps)
"""


def test_an_installed_library_is_found_by_cmake(installed, tmp_path, cmake):
    (tmp_path / "CMakeLists.txt").write_text(USER)
    main = '#include "symid_emps.h"\nint main(void) { return symid_emps_version() == 0; }\n'
    (tmp_path / "main.c").write_text(main)
    cmake(tmp_path, f"-S . -B user -DCMAKE_PREFIX_PATH={installed}", "--build user")
    run(tmp_path, "user/user")
    assert sorted(path.name for path in (installed / "include").iterdir()) == ["symid_emps.h"]


def test_inside_another_project_the_folder_is_a_library_alone(made, tmp_path, cmake):
    write_c(made["two_link"], tmp_path / "c")
    lines = ("cmake_minimum_required(VERSION 3.13)", "project(whole C)", "add_subdirectory(c)")
    (tmp_path / "CMakeLists.txt").write_text("\n".join(lines))
    cmake(tmp_path, "-S . -B b", "--build b")
    assert (tmp_path / "b" / "c" / "libsymid_two_link.a").is_file()
    assert not list((tmp_path / "b").rglob("symid_two_link_selftest*"))


def test_the_archive_keeps_no_function_of_before(made, tmp_path, c_compiler):
    folder = write_c(made["two_link"], tmp_path / "c")
    make(folder, c_compiler, "libsymid_two_link.a")
    spoil(folder / "Makefile", " symid_two_link_bias.o", "")
    run(folder, "touch", "symid_two_link_bias.c", "symid_two_link_info.c")
    make(folder, c_compiler, "libsymid_two_link.a")
    listed = run(folder, "ar", "t", "libsymid_two_link.a").stdout.split()
    assert "symid_two_link_bias.o" not in listed


def test_selection_and_comparison_are_alike_everywhere(tmp_path, c_compiler):
    """No robot of today uses these operations: a function made up for the purpose does."""

    def mix(x):
        return ca.vertcat(x[0] < x[1], ca.sign(x[0]), x[0] <= x[1], ca.fabs(x[2]), ca.tanh(x[1]))

    function, program = make_toy(mix, "mix", x=3)
    joint = JointCard(number=1, name="a", kind="revolute", friction="none")
    rest = {"joints": (joint,), "beta": (), "friction": (), "functions": (program.spec,)}
    card = ModelCard(robot="toy", signature="0", **rest)
    functions = Functions(card=card, programs=(program,), functions=(function,))
    write_python(functions, tmp_path / "p")
    make(write_c(functions, tmp_path / "c"), c_compiler, "shared", "check", flags="-Werror")
    values = np.array([[1, 2, 3], [2, 1, 3], [0, 0, -1], [-1, 5, 0.5], [np.nan, 1, 2], [1, 2, np.nan]])
    wanted = np.array([np.asarray(function(row)).ravel() for row in values])
    for folder in ("c", "p"):
        found = load_library(tmp_path / folder).evaluate("mix", values)[0]
        np.testing.assert_allclose(found[:4], wanted[:4], rtol=0, atol=1e-15)
        assert np.isnan(found[4, :3]).all()
        assert np.isnan(found[5, 3])


FOLLOWED = """
name = "followed"
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
name = "j1"
kind = "revolute"
[[joint]]
name = "j2"
kind = "revolute"
alpha = "pi/2"
a = 0.2
mimic = { joint = "j1", multiplier = -0.63 }
[[joint]]
name = "j3"
kind = "prismatic"
alpha = "pi/2"
[[joint]]
name = "j4"
kind = "prismatic"
alpha = "pi/2"
mimic = { joint = "j3", multiplier = "1/3" }
"""


def test_coordinates_and_joints_are_told_apart():
    functions = build_functions(parse_robot(FOLLOWED), names=("forward_kinematics", "mass_matrix"))
    assert read_record(ModelCard, json.loads(json.dumps(asdict(functions.card)))) == functions.card
    c, python = dict(generate_c_library(functions).files), dict(generate_python_module(functions).files)
    lines = [
        "q[0]: joint 1, j1: revolute, position in rad, torque in N m",
        "q[1]: joint 3, j3: prismatic, position in m, torque in N",
        "joint 2, j2: revolute, follows -0.63 j1, link 2",
        "joint 4, j4: prismatic, follows 1/3 j3, link 4",
    ]
    header, module = c["symid_followed.h"], python["symid_followed.py"]
    assert "\n".join(f" *   {line}" for line in lines) in header
    assert "\n".join(f"    {line}" for line in lines) in module
    for text in (header, module):
        assert "of followed: 4 joints, 2 of them with a coordinate" in text
    assert "#define SYMID_FOLLOWED_JOINTS 2\n" in header
    assert "#define SYMID_FOLLOWED_LINKS 4\n" in header
    assert "[out] R rotation matrices, one a link: 4 x 3 x 3" in header
    # Parameters carry the numbers of their joints, which the lines above name.
    assert {parameter.name[-1] for parameter in functions.card.beta} <= set("1234")
