"""Friction with a memory in C: strict compilation, what it refuses, agreement with NumPy and mpmath."""

import ctypes

import mpmath
import numpy as np
import pytest

from benchmarks.friction_rig import compute_largest_level
from symid.codegen.c_library import build_step_program, generate_friction_state
from symid.codegen.programs import count_operations
from symid.joint_models.carriers import build_float_carrier
from symid.joint_models.dynamic_friction import (
    DYNAMIC_LAWS,
    build_held_path,
    compute_bristle_rate,
    compute_bristle_step,
    get_dynamic_law,
    simulate_dynamic_friction,
)
from tests.builds import run
from tests.friction_forms import build_carrier

STRICT = ("-std=c99", "-fPIC", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow")
STRICT += ("-Wdouble-promotion", "-Wmissing-prototypes", "-Werror")
VALUES = {"dahl": (2e4, 7.0), "lugre": (1e4, 80.0, 10.0, 15.0, 0.02, 1.7, 4.0)}
OK, NULL, PARAMETER, INPUT = range(4)
EXACT = build_carrier(mpmath, mpmath.mpf, absolute=abs, maximum=max, minimum=min)


class Compiled:
    """The functions of a law in C, called with numbers."""

    def __init__(self, folder, compiler, name, precision="double"):
        for file, text in generate_friction_state(get_dynamic_law(name), precision=precision):
            (folder / file).write_text(text)
        stem = f"symid_friction_{name}"
        run(folder, compiler, *STRICT, "-shared", f"{stem}.c", "-o", "friction.so", "-lm")
        shared = ctypes.CDLL(str(folder / "friction.so"))
        self.number = ctypes.c_double if precision == "double" else ctypes.c_float
        self.count = len(get_dynamic_law(name).parameters)
        self.init, self.step = getattr(shared, f"{stem}_init"), getattr(shared, f"{stem}_step")
        self.step.argtypes = [ctypes.c_void_p, self.number, self.number, ctypes.c_void_p]
        self.state = (self.number * (self.count + 1))()
        self.torque = self.number(7.0)

    def begin(self, values):
        return self.init(ctypes.byref(self.state), (self.number * self.count)(*values))

    def move(self, velocity, period):
        code = self.step(ctypes.byref(self.state), velocity, period, ctypes.byref(self.torque))
        return code, self.state[self.count], self.torque.value


@pytest.fixture(params=sorted(DYNAMIC_LAWS))
def name(request):
    return request.param


@pytest.fixture
def compiled(tmp_path, c_compiler, name):
    return Compiled(tmp_path, c_compiler, name)


def find_largest_terms(law, values, velocity, before):
    """Return the largest terms of the state, z and g / sigma0, and of the torque, which contains them."""
    floats = build_float_carrier()
    state = max(abs(before), law.level(floats, velocity, values) / values[0])
    damping, viscous = law.damping(floats, values)
    share = compute_bristle_rate(floats, law, velocity, state, values) - velocity
    return state, max(map(abs, (values[0] * state, damping * velocity, damping * share, viscous * velocity)))


def test_an_evaluation_agrees_with_numpy_and_with_mpmath(name, compiled):
    law, values = get_dynamic_law(name), VALUES[name]
    with mpmath.workdps(40):
        exact = [mpmath.mpf(value) for value in values]
        generator = np.random.default_rng(5)
        for size in 10.0 ** generator.uniform(-8, 1, 300):
            velocity = float(size * generator.choice([-1.0, 1.0]))
            period = float(10.0 ** generator.uniform(-5, 0))
            assert compiled.begin(values) == OK
            before = float(generator.uniform(-1.0, 1.0)) * compute_largest_level(law, values) / values[0]
            compiled.state[compiled.count] = before
            code, after, torque = compiled.move(velocity, period)
            assert code == OK
            held = (mpmath.mpf(velocity), mpmath.mpf(period))
            wanted = compute_bristle_step(EXACT, law, held, mpmath.mpf(before), exact)
            path = build_held_path(np.array([velocity]), period)
            run = simulate_dynamic_friction(law, values, path, state=before)
            largest = find_largest_terms(law, values, velocity, before)
            for found, array, goal, term in zip(
                (after, torque), (run.state[0], run.torque[0]), wanted, largest, strict=True
            ):
                assert abs(mpmath.mpf(found) - goal) <= 1e-14 * term
                assert abs(found - array) <= 1e-14 * term


def test_floats_compile_and_agree_to_their_precision(tmp_path, c_compiler, name):
    law, values = get_dynamic_law(name), VALUES[name]
    compiled = Compiled(tmp_path, c_compiler, name, "float")
    velocity = 0.05 * np.sin(3e-3 * np.arange(3000))
    run = simulate_dynamic_friction(law, values, build_held_path(velocity, 1e-3))
    assert compiled.begin(values) == OK
    torque = [compiled.move(held, 1e-3)[2] for held in velocity.tolist()]
    assert np.abs(torque - run.torque).max() <= 1e-4 * np.abs(run.torque).max()


def test_the_step_is_stable_however_long_it_is(name, compiled):
    law, values = get_dynamic_law(name), VALUES[name]
    compiled.begin(values)
    for period in (1.0, 1e6, 1e300):
        code, state, _ = compiled.move(-0.5, period)
        level = law.level(build_float_carrier(), -0.5, values)
        assert (code, state) == (OK, pytest.approx(-level / values[0], rel=1e-14))


def test_what_cannot_be_used_is_refused_and_nothing_is_written(name, compiled):
    values = VALUES[name]
    for k in range(len(values)):
        for wrong in (-1.0, float("nan"), float("inf")):
            assert compiled.begin((*values[:k], wrong, *values[k + 1 :])) == PARAMETER
    assert list(compiled.state) == [0.0] * len(compiled.state)
    assert compiled.init(None, None) == NULL
    assert compiled.begin(values) == OK
    code, state, torque = compiled.move(0.1, 1e-3)
    for velocity, period in ((float("nan"), 1e-3), (float("inf"), 1e-3), (0.1, -1e-3), (0.1, float("nan"))):
        assert compiled.move(velocity, period) == (INPUT, state, torque)
    assert compiled.step(None, 0.1, 1e-3, ctypes.byref(compiled.torque)) == NULL
    assert compiled.step(ctypes.byref(compiled.state), 0.1, 1e-3, None) == NULL
    assert code == OK


def test_a_step_of_lugre_costs_two_exponentials():
    operations = count_operations(build_step_program(get_dynamic_law("lugre")))
    assert operations.trig <= 3
    assert operations.mul + operations.add <= 26
