"""Generated code of elements: every target tests itself, C and Python agree, and no energy is made."""

import ctypes
import importlib.util
import sys

import numpy as np
import pytest

from symid.codegen import ElementCode, generate_element
from symid.joint_models import describe_inverse, is_passive_element, needs_time, start_states
from tests.builds import run
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
        run(folder, compiler, *flags, f"{prefix}.c", "-o", target, "-lm")
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


@pytest.mark.parametrize(
    ("target", "precision"), [*((target, "double") for target in ("c", "python", "casadi")), ("c", "float")]
)
@pytest.mark.parametrize("name", NAMES)
def test_every_target_passes_its_test(name, target, precision, tmp_path, c_compiler):
    made = write(name, tmp_path / "code", target=target, precision=precision)
    assert made.record.selftest == "passed"
    assert made.operations["step"]["add"] > 0
    assert write(name, tmp_path / "code", target=target, precision=precision).unchanged


def follow(name, folder, compiler, count):
    """Drive C and Python with the same random steps; return outputs, energies and work."""
    c, python = Compiled(name, folder / "c", compiler), load(name, folder / "python")()
    rng = np.random.default_rng(3)
    period = (PERIOD,) * c.timed
    worst, least = 0.0, np.inf
    c.reset()
    work, y, place, stored = 0.0, 0.0, 0.0, python.stored
    for goal in (0.8 * np.sin(np.cumsum(rng.normal(size=count)) * 0.1)).tolist():
        found = python.step(goal, *period)
        worst = max(worst, abs(c.go("step", goal, PERIOD) - found), abs(c.stored - python.stored))
        least = min(least, python.stored)
        work, y, place = work + 0.5 * (y + found) * (goal - place), found, goal
    return worst, least, work - (python.stored - stored)


LONG = [
    pytest.param(name, 1_000_000, marks=pytest.mark.slow) for name in ("knees", "falling", "relays", "lugre")
]


@pytest.mark.parametrize(("name", "count"), [*((name, 5000) for name in NAMES), *LONG])
def test_c_and_python_agree(name, count, tmp_path, c_compiler):
    worst, least, lost = follow(name, tmp_path, c_compiler, count)
    assert worst < 1e-12
    if is_passive_element(ELEMENTS[name]):
        assert least > -1e-12
        assert lost > 0.0


@pytest.mark.parametrize("name", [name for name in NAMES if not describe_inverse(ELEMENTS[name])])
def test_the_inverse_is_undone_by_the_element(name, tmp_path, c_compiler):
    element = load(name, tmp_path / "python")
    c, python = Compiled(name, tmp_path / "c", c_compiler), element(0.1, 1)
    other, period = element(0.1, 1), (PERIOD,) * c.timed
    c.reset(0.1, 1)
    rng = np.random.default_rng(5)
    for goal in np.cumsum(rng.normal(size=400)) * 0.1:
        x = python.inverse(goal, *period)
        assert c.go("inverse", goal, PERIOD) == pytest.approx(x, abs=1e-9)
        assert other.step(x, *period) == pytest.approx(goal, abs=1e-9)


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


def test_casadi_functions_load_elsewhere(tmp_path):
    made = write("knees", tmp_path / "code", target="casadi")
    program = """
import symid_knees as e
y, states, energy = e.step(e.START, 0.3, 1.0)
print(float(e.inverse(e.START, y)))
"""
    assert float(run(made.folder, sys.executable, "-c", program).stdout) == pytest.approx(0.3, abs=1e-12)
