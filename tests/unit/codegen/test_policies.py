"""What every function does with NaN and NULL, one sample and batch, in C and in NumPy."""

import ctypes
import shutil

import numpy as np
import pytest

from symid.codegen.library import load_library
from symid.codegen.programs import Op
from symid.codegen.references import build_references
from symid.options import GenerateOptions
from tests.builds import build_shipped, make, run, write_c, write_python

ROBOTS = ("two_link", "two_link_elastic", "scara")
SAMPLES = 5


@pytest.fixture(scope="module", params=ROBOTS)
def made(request):
    return build_shipped(request.param)


@pytest.fixture(scope="module")
def references(made):
    return build_references(made.card, made.functions, made.programs, GenerateOptions(states=SAMPLES))


@pytest.fixture(scope="module")
def c_folder(made, tmp_path_factory, c_compiler):
    folder = write_c(made, tmp_path_factory.mktemp("policies") / made.card.robot)
    make(folder, c_compiler, "-j2", "shared", flags="-O1")
    return folder


@pytest.fixture(scope="module")
def libraries(made, c_folder, tmp_path_factory):
    folder = write_python(made, tmp_path_factory.mktemp("python") / made.card.robot)
    return {"c": load_library(c_folder), "python": load_library(folder)}


def find_dependence(program, port, element):
    """Return per output port which elements are computed from one element of an input: surely, and perhaps.

    A power may not look at its exponent.
    """
    surely, perhaps = [False], [False]
    for instruction in program.instructions:
        if instruction.op in {Op.INPUT, Op.CONSTANT}:
            here = instruction.op is Op.INPUT and instruction.args == (port, element)
            surely.append(here)
            perhaps.append(here)
            continue
        operands = [abs(ref) for ref in instruction.args]
        seen = operands[:1] if instruction.op is Op.POWER else operands
        surely.append(any(surely[ref] for ref in seen))
        perhaps.append(any(perhaps[ref] for ref in operands))
    return [
        (np.array([surely[abs(ref)] for ref in refs]), np.array([perhaps[abs(ref)] for ref in refs]))
        for refs in program.outputs
    ]


def list_inputs(program, reference):
    rows = (np.array(values) for values in reference.inputs)
    ports = program.spec.inputs
    return [row[0] if port.shared else row for port, row in zip(ports, rows, strict=True)]


@pytest.mark.parametrize("backend", ["c", "python"])
def test_nan_goes_where_it_is_computed_from_and_nowhere_else(made, references, libraries, backend):
    library = libraries[backend]
    for program, reference in zip(made.programs, references, strict=True):
        spec, inputs = program.spec, list_inputs(program, reference)
        clean = library.evaluate(spec.name, *inputs)
        for place, port in enumerate(spec.inputs):
            for element in range(port.size):
                spoilt = [values.copy() for values in inputs]
                spoilt[place][..., element] = np.nan
                batch = library.evaluate(spec.name, *spoilt)
                ports = zip(spec.inputs, spoilt, strict=True)
                single = library.bind(spec.name)(*(v if p.shared else v[1] for p, v in ports))
                expected = find_dependence(program, place, element)
                for many, one, before, (surely, perhaps) in zip(batch, single, clean, expected, strict=True):
                    rows, here = many.reshape(SAMPLES, -1), one.reshape(-1)
                    assert np.isnan(rows[:, surely]).all(), (spec.name, port.name, element)
                    assert np.isnan(here[surely]).all(), (spec.name, port.name, element)
                    same = before.reshape(SAMPLES, -1)[:, ~perhaps]
                    np.testing.assert_array_equal(rows[:, ~perhaps], same)
                    assert not np.isnan(here[~perhaps]).any()


def test_a_nan_in_one_sample_stays_in_it(made, references, libraries):
    for library in libraries.values():
        for program, reference in zip(made.programs, references, strict=True):
            spec, inputs = program.spec, list_inputs(program, reference)
            clean = library.evaluate(spec.name, *inputs)
            spoilt = [v.copy() for v in inputs]
            for port, values in zip(spec.inputs, spoilt, strict=True):
                if not port.shared:
                    values[2] = np.nan
            others = [0, 1, 3, 4]
            for found, before in zip(library.evaluate(spec.name, *spoilt), clean, strict=True):
                np.testing.assert_array_equal(found[others], before[others])


def test_null_is_refused_and_nothing_is_written(made, c_folder):
    prefix = f"symid_{made.card.robot}"
    shared = ctypes.CDLL(str(c_folder / f"lib{prefix}.so"))
    for program in made.programs:
        spec = program.spec
        ports = (*spec.inputs, *spec.outputs)
        arrays = [np.full(max(port.size, 1) * SAMPLES, 0.25) for port in ports]
        for batch in (False, True):
            call = getattr(shared, f"{prefix}_{spec.name}{'_batch' if batch else ''}")
            head = [ctypes.c_size_t(SAMPLES)] if batch else []
            for missing in range(len(ports)):
                pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
                pointers[missing] = ctypes.c_void_p(None)
                assert call(*head, *pointers) == 1, (spec.name, ports[missing].name)
            if batch:
                pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
                assert call(ctypes.c_size_t(0), *pointers) == 0
        assert all((array == 0.25).all() for array in arrays), spec.name


def test_comments_of_the_header_are_complete(made, c_folder):
    """Doxygen reads them as clang does: all parameters of a function for one sample are told."""
    clang = shutil.which("clang")
    if clang is None:
        pytest.skip("wants clang: install it to check the header's comments")
    header = f"symid_{made.card.robot}.h"
    flags = ("-std=c99", "-fsyntax-only", "-Wdocumentation", "-Wdocumentation-pedantic", "-Werror")
    run(c_folder, clang, "-x", "c", *flags, header)
