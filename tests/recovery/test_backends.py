"""The same log gives the same parameters whatever computes the functions: C, NumPy, or CasADi."""

import numpy as np
import pytest

from symid.codegen.cache import prepare_library
from symid.codegen.compiled_models import has_addresses
from symid.identification.elastic.methods import build_elastic_equations, fit_method
from symid.identification.elastic.options import ElasticOptions
from symid.identification.rigid.fit import identify_parameters
from symid.logs.recording import Recording
from symid.robot.description import Processing
from symid.robot.toml_reader import read_robot
from tests.recovery.closed_form import sample_states
from tests.recovery.elastic_runs import find_error, find_truth, prepare_arm, run_arm

OTHERS = ("python", "casadi", "machine")


def prepare(robot, backend, tmp_path_factory):
    """Return a library, that of CasADi's virtual machine for "machine"."""
    if backend == "machine":
        # Without a compiler, and so with notices: not in the cache of the other tests.
        cache = tmp_path_factory.mktemp("machine")
        return prepare_library(robot, backend="casadi", compiler="no-such-compiler", cache=cache)
    return prepare_library(robot, backend=backend)


def assert_same(found, expected):
    """Compare to 1e-9 of each value, and of the largest for those that are nothing beside it."""
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * 1e-3 * np.abs(expected).max())


@pytest.fixture(scope="module")
def rigid(robots_folder, c_compiler):
    robot = read_robot(robots_folder / "two_link.toml")
    library = prepare_library(robot, backend="c")
    time, q, dq, ddq = sample_states(2, 4001, 2e-3)
    beta = np.linspace(1.0, 2.0, len(library.card.beta))
    (tau,) = library.evaluate("inverse_dynamics", q, dq, ddq, beta)
    if library.card.friction:
        tau = tau + library.evaluate("friction", dq, np.linspace(0.5, 1.0, len(library.card.friction)))[0]
    tau += np.random.default_rng(3).normal(0.0, 0.05, tau.shape)
    return robot, library, Recording(time=time, position=q, torque=tau, source="made")


@pytest.mark.parametrize("backend", OTHERS)
@pytest.mark.parametrize("kind", ["torque", "momentum", "energy"])
def test_a_rigid_robot_gets_the_same_parameters(rigid, backend, kind, tmp_path_factory):
    robot, library, recording = rigid
    other = prepare(robot, backend, tmp_path_factory)
    assert (library.backend, other.backend) == ("c", "python" if backend == "python" else "casadi")
    expected, found = (
        identify_parameters(each, [recording], Processing(), rows=kind, estimator="wls")
        for each in (library, other)
    )
    for values in ("value", "std"):
        assert_same(
            [getattr(entry, values) for entry in found.parameters],
            [getattr(entry, values) for entry in expected.parameters],
        )


@pytest.fixture(scope="module")
def elastic(robots_folder, c_compiler):
    robot, library = prepare_arm(robots_folder)
    return robot, library, run_arm(robot, library, noisy=True, duration=6.0).recording


def fit(library, recording, method):
    return fit_method(build_elastic_equations(library, [recording], ElasticOptions()), method)


@pytest.mark.parametrize("backend", OTHERS)
@pytest.mark.parametrize("method", ["two-step", "nlp"])
def test_an_elastic_robot_gets_the_same_parameters(elastic, backend, method, tmp_path_factory):
    robot, library, recording = elastic
    other = prepare(robot, backend, tmp_path_factory)
    expected, found = (fit(each, recording, method) for each in (library, other))
    assert find_error(expected.chi, find_truth(library)) < 0.2
    assert_same(found.chi, expected.chi)


def test_the_compiled_plant_runs_on_the_c_of_casadi(robots_folder, elastic, c_compiler):
    robot, library, _ = elastic
    other = prepare_library(robot, backend="casadi")
    assert has_addresses(other)
    expected, found = (run_arm(robot, each, duration=0.5) for each in (library, other))
    assert (expected.backend, found.backend, found.notices) == ("c", "c", ())
    np.testing.assert_allclose(found.phi, expected.phi, rtol=0, atol=1e-9 * np.abs(expected.phi).max())


def test_the_virtual_machine_of_casadi_has_no_addresses_and_says_so(robots_folder, elastic, tmp_path_factory):
    robot, library, _ = elastic
    other = prepare(robot, "machine", tmp_path_factory)
    assert not has_addresses(other)
    found, expected = (run_arm(robot, each, duration=0.02) for each in (other, library))
    assert found.backend == "python"
    assert "simulate.slow-plant" in [notice.code for notice in found.notices]
    np.testing.assert_allclose(found.phi, expected.phi, rtol=0, atol=1e-9 * np.abs(expected.phi).max())
