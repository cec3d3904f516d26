"""Libraries: only what was built from the folder's sources, and only calls that make sense."""

import shutil
import threading
import tracemalloc
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from symid.codegen import library as library_module
from symid.codegen.cache import prepare_library
from symid.codegen.library import check_outputs, load_library
from symid.codegen.python_targets import generate_casadi_target, generate_python_module
from symid.codegen.source_folder import write_sources
from symid.errors import GenerationError, UsageError
from symid.robot import load_robot
from tests.builds import build_shipped, make, write_c, write_python
from tests.refusals import raises

NAMES = ("gravity", "mass_matrix")


@pytest.fixture(scope="module")
def made():
    return build_shipped("two_link", *NAMES)


@pytest.fixture(scope="module")
def built(made, tmp_path_factory, c_compiler):
    """Return folders of all compiled targets; tests change copies of them."""
    root = tmp_path_factory.mktemp("built")
    write_c(made, root / "c")
    write_c(made, root / "float", precision="float")
    write_sources(generate_casadi_target(made), root / "casadi")
    for name in ("c", "float", "casadi"):
        make(root / name, c_compiler, "shared")
    return root


@pytest.fixture
def folder(built, tmp_path):
    return Path(shutil.copytree(built / "c", tmp_path / "c"))


@pytest.fixture(scope="module")
def prepared(tmp_path_factory, c_compiler):
    """Return a library whose bound functions are built-in ones."""
    return prepare_library(load_robot("two_link"), names=NAMES, cache=tmp_path_factory.mktemp("cache"))


@pytest.fixture(params=["c", "float", "built-in", "python", "casadi", "casadi-machine"])
def library(request, made, tmp_path):
    if request.param == "built-in":
        return request.getfixturevalue("prepared")
    if request.param == "python":
        return load_library(write_python(made, tmp_path / "p"))
    built = request.getfixturevalue("built")
    left = shutil.ignore_patterns("*.so") if request.param == "casadi-machine" else None
    return load_library(
        Path(shutil.copytree(built / request.param.split("-")[0], tmp_path / "p", ignore=left))
    )


def test_a_library_of_other_sources_is_refused_until_it_is_built_again(made, folder, c_compiler):
    load_library(folder)
    for functions, precision in ((build_shipped("two_link", *NAMES, "bias"), "double"), (made, "float")):
        write_c(functions, folder, precision=precision)
        with raises(UsageError, "usage.stale-library"):
            load_library(folder)
    make(folder, c_compiler, "clean", "shared")
    found = load_library(folder).evaluate("mass_matrix", np.zeros((1, 2)), np.ones(len(made.card.beta)))[0]
    assert np.isfinite(found).all()


def test_a_library_that_lacks_a_function_is_refused(folder, monkeypatch):
    library = load_library(folder)
    monkeypatch.setattr(library.engine, "_prefix", "symid_other")
    for call in (library.bind, library.evaluate):
        with raises(UsageError, "usage.stale-library"):
            call("gravity", *([] if call == library.bind else [np.ones(2), np.ones(len(library.card.beta))]))


def test_byte_code_beside_a_module_is_not_run(made, tmp_path):
    load_library(write_python(made, tmp_path / "p"))
    assert not (tmp_path / "p" / "__pycache__").exists()


def test_an_unknown_function_is_refused(library):
    for call in (library.evaluate, library.bind):
        with raises(UsageError, "usage.unknown-function", match="'mass'"):
            call("mass")


Q = np.ones(2)
# What stands for q and beta, None is the right vector of parameters; and what the refusal names.
WRONG = {
    "nothing": ((), "0 arrays"),
    "count": ((Q,), r"q, beta.*\b1\b"),
    "too many": ((Q,) * 9, r"\b9\b"),
    "none": ((None, None), "'q'"),
    "shape": ((np.ones(3), None), r"'q'.*\(2,\)"),
    "size": ((Q[:1], None), "'q'"),
    "scalar": ((0.5, None), "'q'"),
    "batch": ((np.ones((3, 2)), None), "'q'"),
    "ragged": (([[1.0], [2.0, 3.0]], None), "'q'"),
    "text": ((["1", "2"], None), "'q'"),
    "complex": ((Q + 1j, None), "'q'"),
    "objects": (([None, 1.0], None), "'q'"),
    "parameters": ((Q, Q), "'beta'"),
}


@pytest.mark.parametrize("wrong", sorted(WRONG))
def test_what_is_no_array_of_real_numbers_or_not_one_sample_is_refused(library, wrong):
    beta = np.ones(len(library.card.beta))
    given, named = WRONG[wrong]
    values = [beta if value is None and k else value for k, value in enumerate(given)]
    calls = [library.bind("gravity"), partial(library.evaluate, "gravity")]
    for call in calls[: 1 if wrong == "batch" else 2]:
        with raises(UsageError, "usage.shape", match=named):
            call(*values)


def test_a_bound_function_takes_lists_and_whole_numbers(library):
    bound, beta = library.bind("gravity"), np.ones(len(library.card.beta))
    wanted = library.evaluate("gravity", np.array([1.0, 2.0]), beta)[0]
    np.testing.assert_array_equal(bound([1, 2], list(beta))[0], wanted)
    np.testing.assert_array_equal(bound(np.array([1, 2]), beta)[0], wanted)
    strided = np.array([[1.0, 0.0], [2.0, 0.0]])[:, 0]
    np.testing.assert_array_equal(bound(strided, beta)[0], wanted)


def test_the_status_of_a_bound_function_is_looked_at(folder, monkeypatch):
    library = load_library(folder)
    monkeypatch.setattr(type(library.engine), "_get_symbol", lambda *_: lambda *_: 1)
    with raises(GenerationError, "codegen.call-failed", match=r"'\w+'.*\b1\b"):
        library.bind("gravity")(np.ones(2), np.ones(len(library.card.beta)))
    with raises(GenerationError, "codegen.call-failed", match=r"'gravity'.*\b1\b"):
        library.evaluate("gravity", np.ones(2), np.ones(len(library.card.beta)))


def make_arrays(library, samples):
    rng = np.random.default_rng(5)
    q = rng.uniform(-1, 1, (*samples, 2))
    return q, rng.uniform(1, 2, len(library.card.beta))


@pytest.mark.parametrize("samples", [0, 1, 2, 255, 256, 257, 4100])
def test_pieces_of_a_batch_are_put_together(library, samples):
    q, beta = make_arrays(library, (samples,))
    (found,) = library.evaluate("mass_matrix", q, beta)
    assert (found.shape, found.flags.c_contiguous) == ((samples, 2, 2), True)
    single = library.bind("mass_matrix")
    wanted = np.array([single(state, beta)[0] for state in q]).reshape(found.shape)
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("samples", [(), (1,), (1300,)])
def test_outputs_go_into_the_arrays_of_the_caller(library, samples):
    q, beta = make_arrays(library, samples)
    (wanted,) = library.evaluate("mass_matrix", q, beta)
    target = np.full((*samples, 2, 2), np.nan)
    (found,) = library.evaluate("mass_matrix", q, beta, out=(target,))
    assert (found is target, wanted.dtype) == (True, np.float64)
    np.testing.assert_array_equal(target, wanted)


def test_a_batch_is_read_and_written_without_a_copy(folder):
    """The largest block of memory that a call asks for, with arrays of the caller's, is no array."""
    library = load_library(folder)
    q, beta = make_arrays(library, (20000,))
    target = np.empty((20000, 2, 2))
    library.evaluate("mass_matrix", q, beta, out=(target,))
    tracemalloc.start()
    library.evaluate("mass_matrix", q, beta, out=(target,))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20000


@pytest.mark.parametrize("samples", range(1, 9))
def test_new_batches_begin_with_a_line_of_the_cache(library, samples):
    found = library.evaluate("mass_matrix", *make_arrays(library, (samples,)))[0]
    assert (found.ctypes.data % 64, found.shape) == (0, (samples, 2, 2))
    assert found.flags.c_contiguous
    assert found.flags.writeable


@pytest.mark.parametrize("shift", [0, 1])
def test_inputs_that_are_outputs_are_copied_first(library, shift):
    q, beta = make_arrays(library, (700,))
    (wanted,) = library.evaluate("gravity", q, beta)
    block = np.zeros((701, 2))
    given, target = block[:700], block[shift : 700 + shift]
    given[...] = q
    library.evaluate("gravity", given, beta, out=(target,))
    np.testing.assert_array_equal(target, wanted)
    # The code may assume that they are apart: what is not must be copied before.
    state, target = block[0], block.ravel()[shift : 2 + shift]
    state[...] = q[0]
    library.bind("gravity", out=(target,))(state, beta)
    np.testing.assert_array_equal(target, wanted[0])


@pytest.mark.parametrize("samples", [1, 511, 512, 700, 1031])
@pytest.mark.parametrize("threads", [2, 3, 64])
def test_threads_share_a_batch_without_changing_a_byte(folder, samples, threads):
    library = load_library(folder)
    q = np.random.default_rng(samples).normal(size=(samples, 2))
    beta = np.arange(1.0, 1.0 + len(library.card.beta))
    (alone,) = library.evaluate("mass_matrix", q, beta)
    (shared,) = library.evaluate("mass_matrix", q, beta, threads=threads)
    assert alone.tobytes() == shared.tobytes()


def test_no_thread_is_refused(library):
    with raises(UsageError, "usage.threads", match="threads: expected 1 or more, got 0"):
        library.evaluate("mass_matrix", np.zeros(2), np.ones(len(library.card.beta)), threads=0)


def test_a_bound_function_returns_new_arrays_or_writes_to_those_of_the_caller(library):
    q, beta = make_arrays(library, ())
    target = np.full(2, np.nan)
    bound, keeping = library.bind("gravity"), library.bind("gravity", out=[target])
    assert np.isnan(target).all()
    for values in (q + 1.0, q.tolist(), q):
        assert keeping(values, beta)[0] is target
    first = bound(q, beta)[0]
    assert not np.array_equal(first, bound(q + 1.0, beta)[0])
    for found in (first, target):
        np.testing.assert_array_equal(found, library.evaluate("gravity", q, beta)[0])


UNFIT = {
    "one array": (np.empty(2), "ndarray"),
    "too many": ((np.empty(2), np.empty(2)), r"\b2\b"),
    "no array": (([0.0, 0.0],), r"\blist\b"),
    "single precision": ((np.empty(2, dtype=np.float32),), "<f4"),
    "byte order": ((np.empty(2, dtype=">f8"),), ">f8"),
    "shape": ((np.empty(3),), r"\(2,\).*\(3,\)"),
    "stride": ((np.empty(4)[::2],), r"'g'.*\(2,\)"),
    "read-only": ((np.frombuffer(bytes(16)),), r"'g'.*\(2,\)"),
    "unaligned": ((np.frombuffer(bytearray(17), dtype=np.float64, offset=1),), r"'g'.*\(2,\)"),
}


@pytest.mark.parametrize("unfit", sorted(UNFIT))
def test_arrays_that_cannot_take_outputs_are_refused(library, unfit):
    out, text = UNFIT[unfit]
    q, beta = make_arrays(library, ())
    with raises(UsageError, "usage.shape", match=text):
        library.evaluate("gravity", q, beta, out=out)
    with raises(UsageError, "usage.shape", match=text):
        library.bind("gravity", out=out)


def test_outputs_that_share_memory_are_refused(library):
    card = library.card
    port = replace(card.functions[0].outputs[0], shape=(2,))
    spec = replace(card.functions[0], outputs=(port, replace(port, name="other")))
    block = np.empty(3)
    with raises(UsageError, "usage.shape", match=r"'M'.*'other'"):
        check_outputs(card, spec, None, (block[:2], block[1:]))
    apart = (np.empty(2), np.empty(2))
    assert check_outputs(card, spec, None, apart) == apart


def test_an_update_that_runs_is_waited_for(made, tmp_path):
    write_python(made, tmp_path)
    update = tmp_path / ".symid-update-1"
    update.mkdir()
    timer = threading.Timer(0.2, update.rmdir)
    timer.start()
    assert load_library(tmp_path).backend == "python"
    timer.join()


@pytest.mark.parametrize("target", [generate_python_module, generate_casadi_target])
def test_an_update_that_began_while_the_library_was_read_is_seen(made, tmp_path, monkeypatch, target):
    write_sources(target(made), tmp_path)
    read = library_module.source_folder.read_manifest

    def read_and_change(folder):
        found = read(folder)
        with (folder / "README.md").open("a") as file:
            file.write("new")
        return found

    monkeypatch.setattr(library_module.source_folder, "read_manifest", read_and_change)
    with raises(UsageError, "usage.interrupted-update"):
        load_library(tmp_path)
