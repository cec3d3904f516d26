"""Friction with a memory in C: strict compilation, what it refuses, agreement with floats and mpmath."""

import ctypes

import mpmath
import numpy as np
import pytest

from symid.codegen.c_library import build_step_program, generate_friction_state
from symid.codegen.programs import count_operations
from symid.errors import UsageError
from symid.joint_models import advance_memory, build_memory_values, get_law, simulate_dynamic_friction
from tests.builds import run
from tests.friction_forms import build_carrier
from tests.refusals import raises
from tests.state_laws import find_level, give_values, print_values

STRICT = ("-std=c99", "-fPIC", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow")
STRICT += ("-Wdouble-promotion", "-Wmissing-prototypes", "-Werror")
OK, NULL, PARAMETER, INPUT = range(4)
EXACT = build_carrier(mpmath, mpmath.mpf, absolute=abs, maximum=max, minimum=min)


class Compiled:
    """The functions of a law in C, called with numbers, and its values."""

    def __init__(self, folder, compiler, name, precision="double"):
        for file, text in generate_friction_state(get_law(name), precision=precision):
            (folder / file).write_text(text)
        stem = f"symid_friction_{name.replace('+', '_')}"
        run(folder, compiler, *STRICT, "-shared", f"{stem}.c", "-o", "friction.so", "-lm")
        shared = ctypes.CDLL(str(folder / "friction.so"))
        self.number = ctypes.c_double if precision == "double" else ctypes.c_float
        law = get_law(name)
        self.printed = [print_values(name)[entry.name] for entry in (*law.memory, *law.physical)]
        self.values, self.count = build_memory_values(law, print_values(name)), len(self.printed)
        self.init, self.step = getattr(shared, f"{stem}_init"), getattr(shared, f"{stem}_step")
        self.step.argtypes = [ctypes.c_void_p, self.number, self.number, ctypes.c_void_p]
        self.state = (self.number * (self.count + 1))()
        self.torque = self.number(7.0)

    def begin(self, values):
        return self.init(ctypes.byref(self.state), (self.number * self.count)(*values))

    def move(self, velocity, period):
        code = self.step(ctypes.byref(self.state), velocity, period, ctypes.byref(self.torque))
        return code, self.state[self.count], self.torque.value


@pytest.fixture(params=["dahl", "lugre", "lugre+offset"])
def name(request):
    return request.param


@pytest.fixture
def compiled(tmp_path, c_compiler, name):
    return Compiled(tmp_path, c_compiler, name)


def test_an_evaluation_agrees_with_floats_and_with_mpmath(name, compiled):
    p, values, generator = give_values(name), compiled.values, np.random.default_rng(5)
    assert compiled.begin(compiled.printed) == OK
    for size in 10.0 ** generator.uniform(-8, 1, 300):
        velocity, period = (
            float(size * generator.choice([-1.0, 1.0])),
            float(10.0 ** generator.uniform(-5, 0)),
        )
        bend = find_level(p, velocity) / p["sigma0"]
        before = compiled.state[compiled.count] = float(generator.uniform(-1.0, 1.0)) * bend
        code, after, torque = compiled.move(velocity, period)
        assert code == OK
        run = simulate_dynamic_friction(values, np.array([velocity]), np.array([velocity * period]), [before])
        with mpmath.workdps(40):
            exact = {key: mpmath.mpf(value) for key, value in values.items()}
            v, h, z = map(mpmath.mpf, (velocity, period, before))
            force, (bent,) = advance_memory(EXACT, exact, v, v * h, [z])
        # Largest terms of the torque.
        terms = p["sigma0"] * bend + (2.0 * p.get("sigma1", 0.0) + p["Fv"]) * abs(velocity) + 0.2
        for found, array, goal, term in (
            (after, run[1][0, 0], bent, bend),
            (torque, run[0][0], force, terms),
        ):
            assert abs(found - float(goal)) <= 1e-14 * term
            assert abs(found - array) <= 1e-14 * term


def test_floats_compile_and_agree_to_their_precision(tmp_path, c_compiler, name):
    compiled = Compiled(tmp_path, c_compiler, name, "float")
    velocity = 0.05 * np.sin(3e-3 * np.arange(3000))
    wanted, _ = simulate_dynamic_friction(compiled.values, velocity, velocity * 1e-3)
    assert compiled.begin(compiled.printed) == OK
    torque = [compiled.move(held, 1e-3)[2] for held in velocity.tolist()]
    assert np.abs(torque - wanted).max() <= 1e-4 * np.abs(wanted).max()


def test_a_long_step_is_stable_and_what_cannot_be_used_is_refused_and_nothing_is_written(name, compiled):
    values, p = compiled.printed, give_values(name)
    for k in range(len(values)):
        # An offset may be negative.
        for wrong in (float("nan"), float("inf"), -1.0 if k < 4 else -np.inf):
            assert compiled.begin((*values[:k], wrong, *values[k + 1 :])) == PARAMETER
    assert list(compiled.state) == [0.0] * len(compiled.state)
    assert compiled.init(None, None) == NULL
    assert compiled.begin(values) == OK
    for period in (1.0, 1e6, 1e300):
        code, state, torque = compiled.move(-0.5, period)
        assert (code, state) == (OK, pytest.approx(-find_level(p, -0.5) / p["sigma0"], rel=1e-14))
    for velocity, period in ((float("nan"), 1e-3), (float("inf"), 1e-3), (0.1, -1e-3), (0.1, float("nan"))):
        assert compiled.move(velocity, period) == (INPUT, state, torque)
    assert compiled.step(None, 0.1, 1e-3, ctypes.byref(compiled.torque)) == NULL
    assert compiled.step(ctypes.byref(compiled.state), 0.1, 1e-3, None) == NULL


def test_a_step_of_lugre_costs_two_exponentials_and_elements_have_no_struct():
    operations = count_operations(build_step_program(get_law("lugre")))
    assert operations.trig <= 3
    assert operations.mul + operations.add <= 26
    with raises(UsageError, "joint.no-bristles", match="'maxwell-slip' has no bristles"):
        generate_friction_state(get_law("maxwell-slip"))
