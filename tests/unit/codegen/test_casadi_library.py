"""CasADi as a backend: equal to the others, chosen by name, and honest about what serves."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from symid.codegen import cache as cache_module
from symid.codegen.cache import prepare_library
from symid.codegen.casadi_functions import build_functions, prepare_material
from symid.errors import GenerationError, UsageError
from symid.options import GenerateOptions
from symid.robot import load_robot
from tests.refusals import raises

BACKENDS = ("c", "python", "casadi")
# Chains, a tree with coupled drives, springs with stops and knees; of large robots a few functions.
FEW = ("forward_kinematics", "mass_matrix", "forward_dynamics", "torque_regressor")
ROBOTS = dict.fromkeys(("two_link", "two_link_elastic", "scara", "emps")) | {"panda": FEW, "two_arms": FEW}
NAMES = ("gravity", "mass_matrix")


@pytest.mark.parametrize("name", ROBOTS)
def test_all_backends_compute_the_same(c_compiler, name):
    """At random states, with parameters for which no mass matrix is nearly singular; exact values besides."""
    robot = load_robot(name)
    material = prepare_material(build_functions(robot, names=ROBOTS[name]), GenerateOptions())
    names = tuple(program.spec.name for program in material.programs)
    libraries = [prepare_library(robot, names=names, backend=backend) for backend in BACKENDS]
    assert [library.backend for library in libraries] == list(BACKENDS)
    assert not any(library.notices for library in libraries)
    for program, reference in zip(material.programs, material.references, strict=True):
        spec = program.spec
        inputs = [
            np.array(rows[0] if port.shared else rows).reshape(*(() if port.shared else (-1,)), *port.shape)
            for port, rows in zip(spec.inputs, reference.inputs, strict=True)
        ]
        one = [values if port.shared else values[3] for port, values in zip(spec.inputs, inputs, strict=True)]
        found = [library.evaluate(spec.name, *inputs) for library in libraries]
        ports = enumerate(zip(reference.whole, reference.scales, strict=True))
        for place, (whole, scale) in ports:
            exact = np.array(whole).reshape(len(whole), *spec.outputs[place].shape)
            for outputs in found:
                np.testing.assert_allclose(outputs[place][: len(whole)], exact, rtol=0, atol=1e-12 * scale)
                np.testing.assert_allclose(outputs[place], found[0][place], rtol=0, atol=1e-12 * scale)
        for library, outputs in zip(libraries, found, strict=True):
            singles = (library.evaluate(spec.name, *one), library.bind(spec.name)(*one))
            for single in singles:
                for values, batch, scale in zip(single, outputs, reference.scales, strict=True):
                    np.testing.assert_allclose(values, batch[3], rtol=0, atol=1e-12 * scale)


@pytest.fixture(scope="module")
def robot():
    return load_robot("two_link")


@pytest.fixture(scope="module", params=[None, "no-such-compiler"], ids=["compiled", "machine"])
def library(request, robot, c_compiler, tmp_path_factory):
    return prepare(robot, tmp_path_factory.mktemp("cache"), compiler=request.param, backend="casadi")[0]


def test_parameters_of_one_batch_do_not_stay_for_the_next(library):
    q, beta = np.linspace(-1, 1, 600).reshape(-1, 2), np.ones(len(library.card.beta))
    (first,) = library.evaluate("gravity", q, beta)
    (second,) = library.evaluate("gravity", q, 2.0 * beta)
    np.testing.assert_array_equal(second, 2.0 * first)


def test_threads_do_not_meet(library):
    rng, beta = np.random.default_rng(2), np.ones(len(library.card.beta))
    batches = [rng.uniform(-3, 3, (700, 2)) for _ in range(4)]
    wanted = [library.evaluate("gravity", q, beta)[0] for q in batches]
    found = [np.zeros((700, 2)) for _ in batches]

    def work(k):
        for _ in range(20):
            library.evaluate("gravity", batches[k], beta, out=(found[k],))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(4)))
    np.testing.assert_array_equal(found, wanted)


def test_an_error_of_casadi_is_one(library):
    class Buffer:
        def __init__(self, own):
            self.own = own  # what runs needs it

        def ret(self):
            return 3

    library.evaluate("gravity", np.zeros((1, 2)), np.ones(len(library.card.beta)))
    room = library.engine.spare["gravity", 1][0]
    room._buffer = Buffer(room._buffer)
    with raises(GenerationError, "codegen.call-failed", match=r"'gravity'.*\b3\b"):
        library.evaluate("gravity", np.zeros((1, 2)), np.ones(len(library.card.beta)))


def prepare(robot, folder, **options):
    said = []
    found = prepare_library(robot, progress=said.append, names=NAMES, cache=folder, **options)
    return found, [text.split()[0] for text in said]


def test_every_backend_has_an_entry_of_its_own(robot, tmp_path, c_compiler):
    assert prepare(robot, tmp_path, backend="c")[1] == ["deriving", "writing", "compiling"]
    found, said = prepare(robot, tmp_path)
    assert (found.backend, said) == ("c", [])
    for backend, steps in (
        ("casadi", ["deriving", "writing", "compiling"]),
        ("python", ["deriving", "writing"]),
    ):
        made, said = prepare(robot, tmp_path, backend=backend)
        assert (made.backend, said, made.notices) == (backend, steps, ())
        again, said = prepare(robot, tmp_path, backend=backend)
        assert (again.backend, said) == (backend, [])
    assert len(list(tmp_path.iterdir())) == 3


def test_a_compiler_that_is_missing_or_cannot_be_used_is_told_of(robot, tmp_path, c_compiler, monkeypatch):
    """CasADi's virtual machine serves in its place; nothing replaces C when it was asked for."""
    found, said = prepare(robot, tmp_path / "a", backend="casadi", compiler="no-such-compiler")
    assert (found.backend, said) == ("casadi", ["deriving", "writing"])
    (notice,) = found.notices
    assert notice.code == "codegen.no-compiler"
    assert "'no-such-compiler'" in notice.text
    with raises(GenerationError, "codegen.no-compiler", match=r"'no-such-compiler'.*'c'"):
        prepare(robot, tmp_path / "a", backend="c", compiler="no-such-compiler")

    def fail(*_, **options):
        raise GenerationError(cache_module.Notice(code="codegen.compiler-failed", text="no headers"))

    monkeypatch.setattr(cache_module, "compile_sources", fail)
    monkeypatch.setattr(cache_module, "diagnose_compiler", lambda _: "no headers")
    found, _ = prepare(robot, tmp_path / "b", backend="casadi")
    assert [notice.code for notice in found.notices] == ["codegen.compiler-unusable"]
    with raises(GenerationError, "codegen.compiler-unusable", match="'c'"):
        prepare(robot, tmp_path / "b", backend="c")


def test_a_backend_that_is_none_is_refused(robot, tmp_path):
    with raises(UsageError, "usage.backend", match=r"auto, c, python, casadi.*'rust'"):
        prepare(robot, tmp_path, backend="rust")
