"""Built-in functions over compiled code: the bytes of the call through ctypes, or no built-in function."""

import contextlib
import gc
import shutil
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from types import BuiltinFunctionType

import numpy as np
import pytest

from symid.codegen.c_library import write_python_call
from symid.codegen.cache import prepare_library
from symid.codegen.functions import FunctionSpec, ModelCard, Port
from symid.codegen.library import choose_call_path, load_extension, load_library
from symid.errors import GenerationError, UsageError
from symid.robot import load_robot
from tests.builds import build_shipped, make, run, write_c, write_python
from tests.refusals import raises

NAMES = ("gravity", "inverse_dynamics", "forward_kinematics", "mass_matrix", "energy")
STRICT = (
    *("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion"),
    *("-Wmissing-prototypes", "-Wshadow", "-Werror"),
)


@pytest.fixture(scope="module")
def robot():
    return load_robot("two_link")


@pytest.fixture(scope="module")
def library(robot, c_compiler, tmp_path_factory):
    return prepare_library(robot, names=NAMES, cache=tmp_path_factory.mktemp("cache"))


def draw(spec, seed):
    rng = np.random.default_rng(seed)
    return [rng.uniform(-1, 1, port.shape) + 2.0 * port.shared for port in spec.inputs]


def find_spec(library, name):
    return next(spec for spec in library.card.functions if spec.name == name)


def read_bytes(arrays):
    return [(array.shape, array.dtype, array.tobytes()) for array in arrays]


def run_together(find_wrong, count):
    """Call `find_wrong(k)` in threads that take turns as often as can be: none finds a wrong one."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(count) as pool:
            assert not any(pool.map(find_wrong, range(count)))
    finally:
        sys.setswitchinterval(interval)


class Labelled(np.ndarray):
    """A subclass, as users have them."""


UNUSUAL = {
    "list": list,
    "tuple": tuple,
    "integers": lambda values: np.round(values).astype(np.int64),
    "float32": lambda values: values.astype(np.float32),
    "other byte order": lambda values: values.astype(">f8"),
    "every second": lambda values: np.repeat(values, 2)[::2],
    "backwards": lambda values: values[::-1],
    "subclass": lambda values: values.view(Labelled),
    "unaligned": lambda values: np.frombuffer(bytearray(b"0" + values.tobytes()), offset=1).reshape(
        values.shape
    ),
    "read-only": lambda values: np.frombuffer(values.tobytes()).reshape(values.shape),
    "memoryview": memoryview,
}


@pytest.mark.parametrize("kind", sorted(UNUSUAL))
def test_what_is_unusual_is_converted_as_ever(library, kind):
    bound, spec = library.bind("inverse_dynamics"), find_spec(library, "inverse_dynamics")
    values = draw(spec, 1)
    for place in range(len(values)):
        given = [UNUSUAL[kind](v) if k == place else v for k, v in enumerate(values)]
        plain = [np.ascontiguousarray(np.asarray(v, dtype=np.float64)) for v in given]
        assert read_bytes(bound(*given)) == read_bytes(library.evaluate("inverse_dynamics", *plain))


def test_no_reference_is_lost_or_kept(library):
    bound, spec = library.bind("inverse_dynamics"), find_spec(library, "inverse_dynamics")
    values, unusual, shape = draw(spec, 2), [list(v) for v in draw(spec, 2)], spec.outputs[0].shape
    out = (np.empty(shape),)
    keeping = library.bind("inverse_dynamics", out=out)
    watched = [*values, *unusual, out, *out, np.empty, np.dtype(np.float64), bound]
    gc.collect()
    before = [sys.getrefcount(value) for value in watched]
    for _ in range(1000):
        bound(*values), bound(*unusual), keeping(*values), keeping(*unusual)
        with contextlib.suppress(UsageError):
            bound(values[0])
    gc.collect()
    after = [sys.getrefcount(value) for value in watched]
    # Of a thousand rounds; arrays of others, which share their type, come and go.
    assert max(abs(a - b) for a, b in zip(after, before, strict=True)) < 500
    counts = []
    for call in (bound, library.engine.bind_slowly(library.card, spec)):
        found = call(*values)
        (torque,) = found
        counts.append((sys.getrefcount(found), sys.getrefcount(torque)))
    assert counts[0] == counts[1]


@pytest.mark.parametrize("case", ["a function each", "one function", "lists"])
def test_calls_of_many_threads_do_not_mix(library, case):
    one, spec = library.bind("inverse_dynamics"), find_spec(library, "inverse_dynamics")

    def find_wrong(seed):
        values, bound = draw(spec, seed), one
        wanted = read_bytes(library.evaluate("inverse_dynamics", *values))
        if case == "a function each":
            bound = library.bind("inverse_dynamics", out=(np.empty(spec.outputs[0].shape),))
        if case == "lists":
            values = [value.tolist() for value in values]
        return any(read_bytes(bound(*values)) != wanted for _ in range(4000))

    run_together(find_wrong, 2 if case == "a function each" else 4)


def check_fallback(library):
    """The functions are there, through ctypes, and give what they must."""
    bound, spec = library.bind("inverse_dynamics"), find_spec(library, "inverse_dynamics")
    assert type(bound) is not BuiltinFunctionType
    values = draw(spec, 4)
    assert read_bytes(bound(*values)) == read_bytes(library.evaluate("inverse_dynamics", *values))


def hide_folder(monkeypatch, name, folder):
    """Look for headers `name` in an empty folder."""
    found = sysconfig.get_path
    monkeypatch.setattr(sysconfig, "get_path", lambda key: str(folder) if key == name else found(key))


CONFIGURED = sysconfig.get_config_var
HIDE = {
    "Python.h is not installed": lambda patch, folder: hide_folder(patch, "include", folder),
    "arrayobject.h is not installed": lambda patch, folder: patch.setattr(np, "get_include", lambda: folder),
    "no limited API": lambda patch, _: patch.setattr(
        sysconfig, "get_config_var", lambda key: 1 if key == "Py_GIL_DISABLED" else CONFIGURED(key)
    ),
    "not CPython": lambda patch, _: patch.setattr(sys.implementation, "name", "another"),
}


@pytest.mark.parametrize("reason", sorted(HIDE))
def test_what_the_limited_api_cannot_serve_ctypes_does_and_says_why(
    library, robot, tmp_path, monkeypatch, reason
):
    """A library that is made then has no extension module, and its entry is another one."""
    wanted = choose_call_path()
    assert (wanted.name.startswith("Python's limited API"), wanted.remedy) == (True, "")
    HIDE[reason](monkeypatch, str(tmp_path))
    path = choose_call_path()
    assert path.name.startswith("ctypes: ")
    assert reason in path.name
    assert path.flags == ()
    assert bool(path.remedy) == ("installed" in reason)
    made = prepare_library(robot, names=NAMES, cache=library.engine.binary.parent.parent)
    assert made.engine.binary != library.engine.binary
    assert not (made.engine.binary.parent / "python_call.c").exists()
    check_fallback(made)
    # Nor is the extension module of a library used that was made before.
    check_fallback(load_library(library.engine.binary.parent))


def test_both_ways_give_the_same_bytes_and_refuse_the_same(library, tmp_path, monkeypatch):
    hide_folder(monkeypatch, "include", tmp_path)
    slow = load_library(library.engine.binary.parent)
    assert type(library.bind("gravity")) is BuiltinFunctionType
    assert library.bind("gravity").__name__ == "gravity"
    for name in NAMES:
        spec = find_spec(library, name)
        shapes = [port.shape for port in spec.outputs]
        kept, slowly_kept = (tuple(map(np.empty, shapes)) for _ in range(2))
        pairs = (
            (library.bind(name), slow.bind(name)),
            (library.bind(name, out=kept), slow.bind(name, out=slowly_kept)),
        )
        for seed in range(20):
            values = draw(spec, seed)
            for quick, ask in pairs:
                wanted = read_bytes(library.evaluate(name, *values))
                assert read_bytes(quick(*values)) == read_bytes(ask(*values)) == wanted
        wrong = [np.ones(9), *values[1:]]
        for quick, ask in pairs:
            for given in (wrong, values[1:], [None, *values[1:]]):
                texts = []
                for call in (quick, ask):
                    with pytest.raises(UsageError) as caught:
                        call(*given)
                    texts.append(str(caught.value))
                assert texts[0] == texts[1]


def test_an_extension_module_that_does_not_load_is_an_error(tmp_path, c_compiler):
    """As one that was compiled for another NumPy."""
    source = tmp_path / "x.c"
    text = 'PyMODINIT_FUNC PyInit_x(void) { PyErr_SetString(PyExc_ImportError, "old"); return NULL; }'
    source.write_text(f"#include <Python.h>\n{text}\n")
    run(tmp_path, c_compiler, *choose_call_path().flags, "-fPIC", "-shared", "x.c", "-o", "x.so")
    with raises(GenerationError, "codegen.cannot-load", match="old"):
        load_extension(tmp_path / "x.so", "x")


def make_card():
    def port(name, shape):
        return Port(name=name, shape=shape, unit="", meaning="")

    inputs = (port("x", (2,)), port("none", (0,)))
    spec = FunctionSpec(name="twice", inputs=inputs, outputs=(port("y", (2,)),), meaning="twice x")
    return ModelCard(robot="t", signature="", joints=(), beta=(), friction=(), functions=(spec,))


HEADER = "int t_twice(const double *x, const double *none, double *y);\n"
SOURCE = """#include "t.h"
int t_twice(const double *x, const double *none, double *y)
{
    (void)none;
    y[0] = 2.0 * x[0];
    y[1] = 2.0 * x[1];
    return x[0] > 3.0;
}
"""


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_source_compiles_without_a_warning_and_hands_an_error_to_python(tmp_path, compiler):
    if shutil.which(compiler) is None:
        pytest.skip(f"wants {compiler}")
    card = make_card()
    (tmp_path / "t.h").write_text(HEADER)
    (tmp_path / "twice.c").write_text(SOURCE)
    (tmp_path / "python_call.c").write_text(write_python_call(card, "t"))
    flags = (*STRICT, *choose_call_path().flags, "-fPIC", "-shared")
    run(tmp_path, compiler, *flags, "twice.c", "python_call.c", "-o", "t.so")
    asked = []

    def ask(*values):
        asked.append(values)
        x = np.asarray(values[0], dtype=np.float64)
        if x[0] > 3.0:
            message = "refused"
            raise ValueError(message)
        return (2.0 * x,)

    calls = load_extension(tmp_path / "t.so", "t")
    with pytest.raises(KeyError, match="thrice"):
        calls.bind("thrice", ask, None)
    bound = calls.bind("twice", ask, None)
    np.testing.assert_array_equal(bound(np.array([1.0, 2.0]), np.empty(0))[0], [2.0, 4.0])
    assert asked == []
    with pytest.raises(ValueError, match="refused"):
        bound(np.array([4.0, 2.0]), np.empty(0))
    assert len(asked) == 1
    with pytest.raises(TypeError):
        bound(x=np.ones(2), none=np.empty(0))


@pytest.fixture(params=["built in", "double", "float", "module"])
def kept(library, request, tmp_path, c_compiler):
    """Return a call of gravity and the array that it keeps its output in, by one of the ways there are."""
    kind, torque = request.param, np.zeros(2)
    if kind != "built in":
        functions = build_shipped("two_link", "gravity")
        if kind == "module":
            write_python(functions, tmp_path)
        else:
            make(write_c(functions, tmp_path, precision=kind), c_compiler, "shared")
        library = load_library(tmp_path)
    return library.bind("gravity", out=(torque,)), torque


SPOIL = {
    "larger": lambda array: array.resize(100_000, refcheck=False),
    "smaller": lambda array: array.resize(1, refcheck=False),
    "read-only": lambda array: array.setflags(write=False),
    "two axes": lambda array: setattr(array, "shape", (1, 2)),
    "integers": lambda array: setattr(array, "dtype", np.int64),
}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("what", sorted(SPOIL))
def test_an_array_of_the_caller_that_cannot_take_the_output_any_more_is_refused(library, kept, what):
    """Its owner may do so at any time: it was as it must be when the function was bound."""
    (bound, torque), beta = kept, np.ones(len(library.card.beta))
    bound(np.array([0.3, 0.4]), beta)
    SPOIL[what](torque)
    before = torque.tobytes()
    with raises(UsageError, "usage.shape"):
        bound(np.array([0.5, 0.1]), beta)
    assert torque.tobytes() == before


def test_an_array_of_the_caller_that_moved_is_written_where_it_is(library, kept):
    (bound, torque), beta = kept, np.ones(len(library.card.beta))
    torque.resize(100_000, refcheck=False)
    torque.resize(2, refcheck=False)
    (found,) = bound(np.array([0.5, 0.1]), beta)
    assert found is torque
    (wanted,) = library.evaluate("gravity", np.array([0.5, 0.1]), beta)
    np.testing.assert_allclose(torque, wanted, rtol=1e-5)
