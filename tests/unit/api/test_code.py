"""Functions of a robot as code: compiled and called, written to a folder, as SymPy and CasADi objects."""

import json

import numpy as np
import pytest

import symid
from symid.api.code import CompiledModel, RobotFunction, TupleFunction
from symid.errors import UsageError
from tests.refusals import raises


@pytest.fixture(scope="module")
def lib(robot):
    return robot.compile()


def test_a_batch_is_its_samples_and_lists_will_do(lib):
    q = np.random.default_rng(2).normal(size=(5, 2))
    batch = lib.mass_matrix(q, lib.beta)
    single = [lib.mass_matrix(row.tolist(), lib.beta.tolist()) for row in q]
    np.testing.assert_allclose(batch, single, rtol=1e-14)
    (bound,) = lib.mass_matrix.bind()(q[0], lib.beta)
    np.testing.assert_array_equal(bound, single[0])
    out = np.empty((5, 2, 2))
    assert lib.mass_matrix(q, lib.beta, out=out) is out
    np.testing.assert_array_equal(out, batch)


def test_what_symid_itself_runs_on_is_without_functions_for_controllers(robot, lib):
    own, whole = ([spec.name for spec in card.functions] for card in (robot.library.card, lib.card))
    assert set(whole) - set(own) == {
        "coriolis_matrix",
        "slotine_li_regressor",
        "mass_matrix_derivatives",
        "inverse_dynamics_derivatives",
        "forward_dynamics_derivatives",
    }
    assert [name for name in whole if name in own] == own
    assert robot.library.card.signature == lib.card.signature


def test_several_outputs_have_names(lib):
    found = lib.energy([0.1, 0.2], [1.0, 2.0], lib.beta)
    assert isinstance(found, tuple)
    assert found.names == ("T", "V")
    assert found.T is found[0]
    assert repr(found).startswith("Outputs(T=array(")
    with pytest.raises(AttributeError, match="no output 'U'; there are T, V"):
        _ = found.U


@pytest.mark.parametrize("name", ["two_link", "two_link_elastic"])
def test_types_of_functions_are_those_that_editors_are_told(name):
    told = CompiledModel.__annotations__
    lib = symid.load(name, backend="python").compile()
    assert set(lib.functions) <= set(told)
    for entry in lib.functions:
        several = len(getattr(lib, entry).spec.outputs) > 1
        assert told[entry] is type(getattr(lib, entry)) is (TupleFunction if several else RobotFunction)


HEAD = 'convention = "modified"\ngravity = [0, -9.81, 0]\n'
JOINT = '[[joint]]\nname = "{}"\nkind = "revolute"\n'
BENT = f'name = "one"\n{HEAD}{JOINT.format("a")}[joint.friction]\nmodel = "dahl"\nsigma0 = 1e4\n'
PASSIVE = f'name = "two"\n{HEAD}{JOINT.format("a")}actuated = false\n{JOINT.format("b")}a = 0.4\n'


def test_functions_are_made_where_they_are_called(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    lib = symid.load("two_link", backend="python").compile()
    for _ in range(2):
        lib.gravity([0.1, 0.2], lib.beta)
    manifests = (json.loads(path.read_text()) for path in tmp_path.glob("symid/*/manifest.json"))
    made = [entry["name"] for manifest in manifests for entry in manifest["card"]["functions"]]
    assert sorted(made) == ["forward_kinematics", "gravity"]


def test_no_function_of_the_catalogue_is_without_a_type(robot, tmp_path):
    elastic = symid.load("two_link_elastic", backend="python")
    (tmp_path / "one.toml").write_text(BENT)
    bent = symid.load(tmp_path / "one.toml", backend="python")
    (tmp_path / "two.toml").write_text(PASSIVE)
    passive = symid.load(tmp_path / "two.toml", backend="python")
    names = {name for one in (robot, elastic, bent, passive) for name in one.compile().functions}
    assert names == set(CompiledModel.__annotations__)


def test_a_wrong_name_gets_the_nearest(robot, lib):
    with pytest.raises(AttributeError, match="no function 'mass_matrx': did you mean mass_matrix"):
        _ = lib.mass_matrx
    with pytest.raises(AttributeError, match="there are forward_kinematics, jacobian"):
        _ = lib.zzzz
    assert {"mass_matrix", "friction", "beta"} <= set(dir(lib))
    assert "hysteresis_step" not in dir(lib)
    for call in (robot.sympy, robot.casadi):
        with raises(UsageError, "usage.unknown-function", match=r"did you mean gravity\?"):
            call("gravty")


def test_values_are_those_of_the_robot_file(robot, lib, tmp_path):
    assert dict(zip(robot.base.names, lib.beta, strict=True)).items() <= robot.base.values.items()
    assert len(lib.f) == len(robot.base.friction)
    path = tmp_path / "slide.toml"
    path.write_text(
        'name = "slide"\nconvention = "modified"\ngravity = [0, 0, -9.81]\n'
        '[[joint]]\nname = "axis"\nkind = "prismatic"\n'
    )
    slide = symid.load(path, backend="python").compile()
    with raises(UsageError, "usage.no-values", match=r"beta: .* does not state the values of M1"):
        _ = slide.beta


def test_it_shows_itself_in_one_line(lib):
    assert repr(lib) == f"<CompiledModel two_link: 19 functions, {lib.backend}>"
    assert repr(lib.mass_matrix).startswith("<mass_matrix(q[2], beta[6]) -> M[2, 2]: joint-space mass")


def test_casadi_computes_the_same(robot, lib):
    other = symid.load("two_link", backend="casadi").compile()
    assert other.backend == "casadi"
    q = np.random.default_rng(3).normal(size=(4, 2))
    np.testing.assert_allclose(other.mass_matrix(q, lib.beta), lib.mass_matrix(q, lib.beta), rtol=1e-13)
    function = robot.casadi("mass_matrix")
    np.testing.assert_allclose(function(q[0], lib.beta).full(), lib.mass_matrix(q[0], lib.beta), rtol=1e-13)
    constant = robot.casadi("mass_matrix", constant=True)
    np.testing.assert_allclose(constant(q[0]).full(), lib.mass_matrix(q[0], lib.beta), rtol=1e-13)


@pytest.mark.parametrize(
    ("target", "options", "code"),
    [
        ("rust", {}, "usage.target"),
        ("c", {"parameters": "all"}, "usage.parameters"),
        ("python", {"friction_laws": True}, "usage.friction-laws"),
        ("casadi", {"precision": "float"}, "usage.precision"),
        ("python", {"trigonometry": "library"}, "usage.precision"),
        ("python", {"functions": ["gravty"]}, "usage.unknown-function"),
    ],
)
def test_what_is_not_offered_is_refused(robot, tmp_path, target, options, code):
    with raises(UsageError, code):
        robot.write(target, tmp_path / "code", **options)
    assert list(tmp_path.iterdir()) == []
