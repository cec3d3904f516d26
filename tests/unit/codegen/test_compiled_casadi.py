"""CasADi functions that call the generated C: values, Jacobians, and C that CasADi generates from them."""

import casadi as ca
import numpy as np
import pytest

from symid.codegen.casadi_functions import build_casadi_function
from symid.codegen.compiled_models import COMPILED, build_compiled_function
from symid.errors import UsageError
from symid.robot import load_robot
from tests.builds import run

BETA = [4.0, 0.3, 0.2, 1.0, 0.3, 0.1, 0.2, 0.4]


@pytest.fixture(scope="module")
def robot():
    return load_robot("two_link")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


def draw(function):
    rng = np.random.default_rng(8)
    inputs = [rng.uniform(-1, 1, function.size1_in(k)) for k in range(function.n_in())]
    return [*inputs[:3], *(np.array(BETA[: len(entry)]) for entry in inputs[3:])]


@pytest.mark.parametrize("constant", [False, True])
@pytest.mark.parametrize("name", COMPILED)
def test_values_and_jacobians_are_those_of_casadi(robot, cache, c_compiler, name, constant):
    found = build_compiled_function(robot, name, constant=constant, cache=cache)
    plain = build_casadi_function(robot, name, constant=constant)
    assert str(found).split(" ")[0] == str(plain).split(" ")[0], "names and shapes are the same"
    inputs = draw(plain)
    np.testing.assert_allclose(found(*inputs), plain(*inputs), rtol=0, atol=1e-12)
    symbols = [ca.MX.sym("x", *plain.size_in(k)) for k in range(plain.n_in())]
    for symbol in symbols:
        mine, theirs = (
            ca.Function("slope", symbols, [ca.jacobian(f(*symbols), symbol)])(*inputs) for f in (found, plain)
        )
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-11)


def test_samples_side_by_side_and_inputs_left_out(robot, cache, c_compiler):
    found = build_compiled_function(robot, "inverse_dynamics", cache=cache)
    plain = build_casadi_function(robot, "inverse_dynamics")
    samples = [np.tile(value[:, None], 3) * [1.0, 2.0, -1.0] for value in draw(plain)]
    np.testing.assert_allclose(found.map(3)(*samples), plain.map(3)(*samples), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found()["tau"], np.zeros((2, 1)))


def test_c_that_casadi_generates_calls_the_library(robot, c_compiler, tmp_path):
    """What acados compiles: C of an expression, linked with the library."""
    cache = tmp_path / "cache"
    dynamics = build_compiled_function(robot, "forward_dynamics", constant=True, cache=cache)
    x, u = ca.MX.sym("x", 4), ca.MX.sym("u", 2)
    rate = ca.vertcat(x[2:], dynamics(x[:2], x[2:], u))
    model = ca.Function("model", [x, u], [rate, ca.jacobian(rate, ca.vertcat(x, u))])
    generator = ca.CodeGenerator("model")
    generator.add(model)
    (tmp_path / "model.c").write_text(generator.dump(), encoding="utf-8")
    (library,) = cache.glob("external-forward_dynamics-*/forward_dynamics.so")
    link = (str(library), f"-Wl,-rpath,{library.parent}")
    run(tmp_path, c_compiler, "-shared", "-fPIC", "model.c", *link, "-o", "model.so")
    loaded = ca.external("model", str(tmp_path / "model.so"))
    point = (np.array([0.3, -0.2, 0.5, 0.1]), np.array([1.0, -2.0]))
    for mine, theirs in zip(loaded(*point), model(*point), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-14)


def test_a_function_without_a_generated_derivative_is_refused(robot):
    with pytest.raises(UsageError, match="there are inverse_dynamics, forward_dynamics"):
        build_compiled_function(robot, "energy")
