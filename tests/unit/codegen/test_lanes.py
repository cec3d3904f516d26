"""Sines of several angles at once and blocks of samples side by side: against mpmath, and for every width."""

import ctypes
import json
import math
import subprocess
from pathlib import Path

import mpmath
import numpy as np
import pytest

from symid.codegen.c_library import generate_c_library, write_simd_header
from symid.codegen.casadi_functions import build_functions
from symid.codegen.compiler import locate_compiler
from symid.codegen.functions import list_robot_specs
from symid.codegen.printing import group_angles, print_c, print_simd
from symid.codegen.programs import ExpressionTable, Op, Program
from symid.codegen.source_folder import write_sources
from symid.dynamics.base_parameters import derive_base_parameters
from symid.options import GenerateOptions
from symid.robot import load_robot
from symid.robot.toml_reader import parse_robot
from tests.builds import build_shipped, make, write_c
from tests.sx_programs import make_spec

COMPILER = locate_compiler()
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="wants a C compiler: install gcc")
WIDTHS = (1, 2, 4, 8, 16)
ONE_BY_ONE = ("-O2", "-DTEST_LANES=1", "-DTEST_ONE_BY_ONE")
"""What processors without registers for vectors get."""
TYPES = {"double": (ctypes.c_double, np.float64, 1e6), "float": (ctypes.c_float, np.float32, 1e4)}
CALLER = """
#include "lanes.h"
#include "caller.h"
void call(size_t n, const real *x, real *s, real *c)
{
    for (size_t k = 0; k < n; k += 8) {
        const real *y = x + k;
        const lanes angles[ROOM(8)] = {EIGHT(y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])};
        lanes sines[ROOM(8)];
        lanes cosines[ROOM(8)];
        find_sines(COUNT(8), angles, sines, cosines);
        for (size_t i = 0; i < 8; ++i) {
            s[k + i] = AT(sines, i);
            c[k + i] = AT(cosines, i);
        }
    }
}
"""


def build(folder: Path, precision: str, *flags: str):
    (folder / "lanes.h").write_text(write_simd_header("TEST", precision))
    (folder / "caller.h").write_text(f"typedef {precision} real;\n")
    (folder / "caller.c").write_text(CALLER)
    target = folder / f"lib{abs(hash(flags))}.so"
    warnings = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror")
    compile_one = (COMPILER.path, "-std=c99", *warnings, *flags, "-fPIC", "-c", "caller.c", "-o", "caller.o")
    # Linked apart: with -ffast-math, a library turns subnormal numbers off in the whole process.
    link = (COMPILER.path, "-shared", "caller.o", "-o", target, "-lm")
    for command in (compile_one, link):
        subprocess.run(command, cwd=folder, check=True)
    shared, kind = ctypes.CDLL(str(target)), TYPES[precision][1]

    def call(angles):
        x = np.ascontiguousarray(angles, dtype=kind)
        outputs = np.empty_like(x), np.empty_like(x)
        places = [ctypes.c_void_p(array.ctypes.data) for array in (x, *outputs)]
        shared.call(ctypes.c_size_t(x.size), *places)
        return outputs

    return call


def find_units(values, exact, kind):
    """Return errors in units in the last place of the exact values (those of 2^-60 for ever smaller ones)."""
    size = np.abs(np.array([float(v) for v in exact], dtype=kind))
    units = np.spacing(np.maximum(size, kind(2.0**-60))).astype(np.float64)
    errors = [abs(mpmath.mpf(float(value)) - x) for value, x in zip(values, exact, strict=True)]
    return np.array([float(error) for error in errors]) / units


# The worst of some million angles: near multiples of pi/2, far out.
WORST = (9822.3146947178702, -129350.87192003803, -19080.21183884373, 321307.9594422229, -9201.474609375)
NEAR = 100.0


def draw_angles(precision: str) -> np.ndarray:
    _, kind, limit = TYPES[precision]
    rng = np.random.default_rng(7)
    quarters = np.arange(-200, 200) * (math.pi / 2)
    far = np.round(rng.uniform(-limit, limit, 200) / (math.pi / 2)) * (math.pi / 2)
    plain = [rng.uniform(-reach, reach, 600) for reach in (0.8, 4.0, 30.0, limit)]
    near = [kind(quarters), np.nextafter(kind(quarters), kind(9e9)), kind(far)]
    small = rng.uniform(-1, 1, 96) * 10.0 ** rng.uniform(-30, 0, 96)
    angles = np.concatenate([*plain, *near, small, [0.0, limit, -limit]]).astype(kind)
    angles = np.concatenate([angles, [kind(x) for x in WORST if abs(x) <= limit]])
    return np.concatenate([angles, np.zeros(-angles.size % 8, dtype=kind)])


EACH_TYPE = pytest.mark.parametrize("precision", TYPES)
NATIVE = ("-O2", "-march=native", "-ffp-contract=fast")


@needs_compiler
@EACH_TYPE
@pytest.mark.parametrize("flags", [("-O0",), ("-O2",), NATIVE, ("-O3", "-ffp-contract=off"), ONE_BY_ONE])
def test_sines_err_by_few_units(tmp_path, precision, flags):
    kind = TYPES[precision][1]
    angles = draw_angles(precision)
    sines, cosines = build(tmp_path, precision, *flags)(angles)
    with mpmath.workdps(60):
        exact = [mpmath.mpf(float(x)) for x in angles]
        worst = [
            find_units(found, [function(x) for x in exact], kind)
            for found, function in ((sines, mpmath.sin), (cosines, mpmath.cos))
        ]
    far = 4.0 if "-march=native" in flags else 3.0
    for errors in worst:
        assert np.max(errors[np.abs(angles) <= NEAR]) < 2.0
        assert np.max(errors) < far


@needs_compiler
@EACH_TYPE
def test_every_width_gives_the_same_digits(tmp_path, precision):
    angles = draw_angles(precision)
    flags = ("-O2", "-ffp-contract=off", "-Wno-psabi")
    first, *others = (build(tmp_path, precision, *flags, f"-DTEST_LANES={width}")(angles) for width in WIDTHS)
    for other in others:
        np.testing.assert_array_equal(other, first)


@needs_compiler
@EACH_TYPE
@pytest.mark.parametrize(
    "flags",
    [("-O2",), ("-O2", "-DTEST_LANES=1"), ("-O2", "-DTEST_LIBRARY_SINES", "-DTEST_LANES=1"), ONE_BY_ONE],
)
def test_angles_that_are_far_or_none(tmp_path, precision, flags):
    _, kind, limit = TYPES[precision]
    with np.errstate(over="ignore"):
        angles = np.array([limit * 1.01, -1e15, 1e30, 3e38, 1.0, np.nan, np.inf, -np.inf]).astype(kind)
    sines, cosines = build(tmp_path, precision, *flags)(angles)
    with mpmath.workdps(60):
        exact = [mpmath.mpf(float(x)) for x in angles[:5]]
        assert np.max(find_units(sines[:5], [mpmath.sin(x) for x in exact], kind)) < 2.0
        assert np.max(find_units(cosines[:5], [mpmath.cos(x) for x in exact], kind)) < 2.0
    assert np.isnan(sines[5:]).all()
    assert np.isnan(cosines[5:]).all()


@needs_compiler
@pytest.mark.parametrize(("precision", "allowed"), [("double", 3e-15), ("float", 2e-6)])
@pytest.mark.parametrize("flags", [("-ffast-math",), ("-ffast-math", "-fno-finite-math-only")])
def test_relaxed_arithmetic_costs_some_digits_and_no_more(tmp_path, precision, allowed, flags):
    angles = np.linspace(-20.0, 20.0, 800).astype(TYPES[precision][1])
    sines, cosines = build(tmp_path, precision, "-O3", "-march=native", *flags)(angles)
    exact = angles.astype(np.float64)
    np.testing.assert_allclose(sines, np.sin(exact), rtol=0, atol=allowed)
    np.testing.assert_allclose(cosines, np.cos(exact), rtol=0, atol=allowed)


@pytest.fixture(scope="module")
def blocks():
    robot = load_robot("puma560")
    # The derivatives alone are half of all instructions, and printed as the others are.
    base = derive_base_parameters(robot)
    names = [spec.name for spec in list_robot_specs(robot, base)]
    names = [name for name in names if not name.endswith("derivatives")]
    functions = build_functions(robot, names=tuple(names))
    return {kind: generate_c_library(functions, GenerateOptions(precision=kind)) for kind in TYPES}


@needs_compiler
@pytest.mark.parametrize(
    ("width", "precision"), [*((width, "double") for width in (1, 2, 4, 8)), (16, "float")]
)
def test_batches_of_every_width_agree_with_single_samples(tmp_path, width, precision, blocks):
    blocks = blocks[precision]
    write_sources(blocks, tmp_path / "code")
    macro = json.loads(blocks.manifest)["prefix"].upper()
    # Blocks of two, eight and sixteen go past the caches, however few bytes they are.
    streamed = f" -D{macro}_STREAMED=0" * (width in {2, 8, 16})
    assert f"#ifndef {macro}_STREAMED" in dict(blocks.files)[f"{macro.lower()}_lanes.h"]
    flags = f"-O1 -Wno-psabi -D{macro}_LANES={width}{streamed}"
    done = make(tmp_path / "code", COMPILER.path, "check", flags=flags, check=False)
    count = len(json.loads(blocks.manifest)["operations"])
    assert done.stdout.endswith(f"0 of {count} functions failed\n"), done.stdout + done.stderr


def build_program(table: ExpressionTable, *refs: int) -> Program:
    return table.build_program(make_spec({"x": 9}, {"y": len(refs)}), [list(refs)])


def test_angles_are_what_comes_from_inputs_alone():
    table = ExpressionTable()
    x, y = table.input(0, 0), table.input(0, 1)
    turned = table.add(y, table.constant(0.5))
    inner = table.apply(Op.SIN, x)
    program = build_program(
        table, table.apply(Op.SIN, inner), table.apply(Op.COS, turned), table.mul(x, inner)
    )
    angles, _ = group_angles(program)
    assert list(angles.values()) == [0, 1]
    text = "\n".join(print_c(program, "double", together=True).statements)
    assert "EIGHT(x[0], t" in text
    assert " = sin(t" in text
    assert " = AT(cosines, 1);" in text
    assert print_simd(program, "double").statements == (), (
        "a sine of a sine calls the library, one sample at a time"
    )


def test_programs_with_other_functions_have_no_block():
    table = ExpressionTable()
    x = table.input(0, 0)
    assert print_simd(build_program(table, table.apply(Op.TANH, x)), "double").statements == ()
    assert print_simd(build_program(table, table.mul(x, x)), "double").statements == (
        "const lanes x0 = GATHER(x + 9 * k, 9);",
        f"const lanes t{2} = x0 * x0;",
        "store_one(y + 1 * k, 1, t2);",
    )


@pytest.mark.parametrize(("size", "place"), [(24, "y + 24 * k"), (64, "y_to")])
def test_a_batch_clears_outputs_that_are_mostly_zero(size, place):
    table = ExpressionTable()
    x, zero = table.input(0, 0), table.constant(0.0)
    clear, load, *stores = print_simd(build_program(table, x, *[zero] * (size - 1)), "double").statements
    assert clear == f"memset({place}, 0, {size} * sizeof(lanes));"
    assert load == "const lanes x0 = GATHER(x + 9 * k, 9);"
    assert [line.partition("(const")[0] for line in stores] == [f"store_eight({place}, {size}, "]
    full = print_simd(build_program(table, *[x] * size), "double").statements
    assert "memset" not in "".join(full)


def test_library_sines_are_calls(tmp_path):
    functions = build_shipped("two_link")
    own, library = (
        dict(generate_c_library(functions, GenerateOptions(trigonometry=kind)).files)
        for kind in ("own", "library")
    )
    name = "symid_two_link_gravity.c"
    assert " sin(" not in own[name]
    assert " = sin(q[0]);" in library[name]
    assert set(own) - set(library) == {"symid_two_link_lanes.h"}
    assert "symid_two_link_lanes.h" not in own["CMakeLists.txt"], "it is not installed"
    assert "symid_two_link_lanes.h" in own["Makefile"]


SLIDE = """
name = "slide_lanes"
convention = "modified"
gravity = [0, 0, -9.81]
[[joint]]
kind = "prismatic"
"""


@needs_compiler
def test_a_robot_without_angles_has_blocks_too(tmp_path):
    write_c(build_functions(parse_robot(SLIDE)), tmp_path)
    flags = "-O1 -Wundef -Werror -Wno-psabi -DSYMID_SLIDE_LANES_LANES=4"
    make(tmp_path, COMPILER.path, "check", flags=flags)


def test_the_header_of_a_robot_called_lanes_is_installed():
    files = dict(generate_c_library(build_functions(parse_robot(SLIDE))).files)
    assert "install(FILES symid_slide_lanes.h DESTINATION" in files["CMakeLists.txt"]
    assert set(files) > {"symid_slide_lanes.h", "symid_slide_lanes_lanes.h"}


@needs_compiler
def test_other_widths_are_refused(tmp_path):
    with pytest.raises(subprocess.CalledProcessError):
        build(tmp_path, "double", "-DTEST_LANES=3")
