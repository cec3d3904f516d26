"""The same log gives the same parameters whatever computes the functions: C, NumPy, or CasADi."""

from functools import cache

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
from tests.recovery.elastic_runs import find_error, find_truth, run_arm

OTHERS = ("python", "casadi", "machine")


@pytest.fixture(scope="module")
def prepare(tmp_path_factory):
    """Return what makes a library, once: that of CasADi's virtual machine for "machine"."""

    @cache
    def get(robot, backend):
        if backend == "machine":
            # Without a compiler, and so with notices: not in the cache of the other tests.
            folder = tmp_path_factory.mktemp("machine")
            return prepare_library(robot, backend="casadi", compiler="no-such-compiler", cache=folder)
        return prepare_library(robot, backend=backend)

    return get


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
def test_a_rigid_robot_gets_the_same_parameters(rigid, backend, kind, prepare):
    robot, library, recording = rigid
    other = prepare(robot, backend)
    assert (library.backend, other.backend) == ("c", "python" if backend == "python" else "casadi")
    expected, found = (
        identify_parameters(each, [recording], Processing(), rows=kind, estimator="wls")
        for each in (library, other)
    )
    for name in ("value", "std"):
        assert_same(*([getattr(entry, name) for entry in fit.parameters] for fit in (found, expected)))


@cache
def fit(library, recording, method):
    return fit_method(build_elastic_equations(library, [recording], ElasticOptions()), method)


@pytest.fixture(scope="module")
def elastic(arm, c_compiler):
    assert c_compiler
    return *arm, run_arm(*arm, noisy=True, duration=6.0).recording


@pytest.mark.parametrize("backend", OTHERS)
@pytest.mark.parametrize("method", ["two-step", "nlp"])
def test_an_elastic_robot_gets_the_same_parameters(elastic, backend, method, prepare):
    robot, library, recording = elastic
    other = prepare(robot, backend)
    expected, found = (fit(each, recording, method) for each in (library, other))
    assert find_error(expected.chi, find_truth(library)) < 0.2
    assert_same(found.chi, expected.chi)


@pytest.mark.parametrize(("backend", "duration"), [("casadi", 0.5), ("machine", 0.02)])
def test_a_compiled_plant_runs_on_the_c_of_casadi_and_a_slow_one_on_its_machine(
    elastic, prepare, backend, duration
):
    robot, library, _ = elastic
    other = prepare(robot, backend)
    expected, found = (run_arm(robot, each, duration=duration) for each in (library, other))
    compiled = backend == "casadi"
    assert has_addresses(other) == compiled
    assert (expected.backend, found.backend) == ("c", "c" if compiled else "python")
    codes = [notice.code for notice in found.recording.notices]
    assert codes == [] if compiled else "simulate.slow-plant" in codes
    np.testing.assert_allclose(found.phi, expected.phi, rtol=0, atol=1e-9 * np.abs(expected.phi).max())
