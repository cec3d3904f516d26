"""Generated code of elements: every target tests itself, C and Python agree, and no energy is made."""

import ctypes
import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from symid.codegen import ElementCode, generate_element
from symid.errors import OutputError
from symid.joint_models import describe_inverse, is_passive_element, needs_time, start_states
from tests.elements import ELEMENTS

NAMES = tuple(ELEMENTS)
PERIOD = 1e-3


def write(name, folder, **options):
    order = ElementCode(name=name, reach=0.8, **options)
    return generate_element(ELEMENTS[name], order, folder, progress=lambda _: None)


class Compiled:
    """The C code behind the calls of the Python code."""

    def __init__(self, name, folder, compiler):
        made, self.timed = write(name, folder), needs_time(ELEMENTS[name])
        prefix = made.manifest["prefix"]
        flags = ("-O2", "-ffp-contract=off", "-shared", "-fPIC")
        target = folder.parent / f"{prefix}.so"
        subprocess.run([compiler, *flags, folder / f"{prefix}.c", "-o", target, "-lm"], check=True)
        self.library = ctypes.CDLL(str(target))
        self.prefix, self.value = prefix, ctypes.c_double()
        self.state = (ctypes.c_double * (len(start_states(ELEMENTS[name], 0.0)) + 2))()
        self.calls = {kind: getattr(self.library, f"{prefix}_{kind}") for kind in ("reset", "step")}
        if not describe_inverse(ELEMENTS[name]):
            self.calls["inverse"] = getattr(self.library, f"{prefix}_inverse")

    def reset(self, x=0.0, side=0):
        return self.calls["reset"](self.state, ctypes.c_double(x), side)

    def go(self, kind, value, *period):
        given = map(ctypes.c_double, (value, *period) if self.timed else (value,))
        code = self.calls[kind](self.state, *given, ctypes.byref(self.value))
        return code or self.value.value

    @property
    def stored(self):
        return self.state[len(self.state) - 1]


def load(name, folder):
    made = write(name, folder, target="python")
    spec = importlib.util.spec_from_file_location(name.replace("-", "_"), made.files[0])
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Element


@pytest.mark.parametrize("target", ["c", "python", "casadi"])
@pytest.mark.parametrize("name", NAMES)
def test_every_target_passes_its_test(name, target, tmp_path, c_compiler):
    assert c_compiler
    made = write(name, tmp_path / "code", target=target)
    assert made.record.selftest == "passed"
    assert made.operations["step"]["add"] > 0
    again = write(name, tmp_path / "code", target=target)
    assert again.unchanged


@pytest.mark.parametrize("name", NAMES)
def test_floats_pass_their_test(name, tmp_path, c_compiler):
    assert c_compiler
    assert write(name, tmp_path / "code", precision="float").record.selftest == "passed"


def follow(name, folder, compiler, count):
    """Drive C and Python with the same random steps; return outputs, energies and work."""
    c, python = Compiled(name, folder / "c", compiler), load(name, folder / "python")()
    rng = np.random.default_rng(3)
    x = np.cumsum(rng.normal(size=count)) * 0.1
    x = (0.8 * np.sin(x)).tolist()
    timed, worst, least = c.timed, 0.0, np.inf
    c.reset()
    work, y, place, stored = 0.0, 0.0, 0.0, python.stored
    for goal in x:
        found = python.step(goal, PERIOD) if timed else python.step(goal)
        worst = max(worst, abs(c.go("step", goal, PERIOD) - found), abs(c.stored - python.stored))
        least = min(least, python.stored)
        work, y, place = work + 0.5 * (y + found) * (goal - place), found, goal
    return worst, least, work - (python.stored - stored)


@pytest.mark.parametrize("name", NAMES)
def test_c_and_python_agree(name, tmp_path, c_compiler):
    worst, least, lost = follow(name, tmp_path, c_compiler, 5000)
    assert worst < 1e-12
    if is_passive_element(ELEMENTS[name]):
        assert least > -1e-12
        assert lost > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["knees", "falling", "relays", "lugre"])
def test_c_and_python_agree_over_a_million_steps(name, tmp_path, c_compiler):
    worst, least, lost = follow(name, tmp_path, c_compiler, 1_000_000)
    assert worst < 1e-12
    if is_passive_element(ELEMENTS[name]):
        assert least > -1e-12
        assert lost > 0.0


@pytest.mark.parametrize("name", [name for name in NAMES if not describe_inverse(ELEMENTS[name])])
def test_the_inverse_is_undone_by_the_element(name, tmp_path, c_compiler):
    element = load(name, tmp_path / "python")
    c, python = Compiled(name, tmp_path / "c", c_compiler), element(0.1, 1)
    other, timed = element(0.1, 1), needs_time(ELEMENTS[name])
    c.reset(0.1, 1)
    rng = np.random.default_rng(5)
    for goal in np.cumsum(rng.normal(size=400)) * 0.1:
        x = python.inverse(goal, PERIOD) if timed else python.inverse(goal)
        assert c.go("inverse", goal, PERIOD) == pytest.approx(x, abs=1e-9)
        back = other.step(x, PERIOD) if timed else other.step(x)
        assert back == pytest.approx(goal, abs=1e-9)


def test_wrong_numbers_are_refused_and_nothing_moves(tmp_path, c_compiler):
    c = Compiled("lugre", tmp_path / "c", c_compiler)
    assert c.reset(np.nan) == 2
    assert c.reset(0.2) == 0
    before = list(c.state)
    for wrong in ((np.inf, PERIOD), (0.3, 0.0), (0.3, -1.0), (0.3, np.nan)):
        assert c.go("step", *wrong) == 2
        assert list(c.state) == before
    assert c.library.symid_lugre_reset(None, ctypes.c_double(0.0), 0) == 1
    python = load("lugre", tmp_path / "python")(0.2)
    memory = list(python.memory)
    for wrong in ((np.inf, PERIOD), (0.3, 0.0), (0.3, np.nan)):
        with pytest.raises(ValueError, match="finite"):
            python.step(*wrong)
        assert python.memory == memory


def test_an_element_without_inverse_has_none_and_says_why(tmp_path):
    made = write("gap", tmp_path / "code")
    header = (made.folder / "symid_gap.h").read_text()
    assert "_inverse" not in header
    assert "Inverse: none: within the backlash" in header


def test_what_is_not_ours_is_not_touched(tmp_path):
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "notes.txt").write_text("mine")
    with pytest.raises(OutputError):
        write("stops", tmp_path / "code")
    assert [path.name for path in (tmp_path / "code").iterdir()] == ["notes.txt"]


def test_casadi_functions_load_elsewhere(tmp_path):
    made = write("knees", tmp_path / "code", target="casadi")
    program = """
import symid_knees as e
y, states, energy = e.step(e.START, 0.3, 1.0)
print(float(e.inverse(e.START, y)))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=made.folder, capture_output=True, text=True, check=True
    )
    assert float(done.stdout) == pytest.approx(0.3, abs=1e-12)
