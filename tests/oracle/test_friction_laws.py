"""Generated C of every static friction law against NumPy and against 40 digits."""

import ctypes

import mpmath
import numpy as np
import pytest

from symid.codegen.c_library import build_law_program, generate_friction_laws
from symid.joint_models.friction_catalogue import get_law
from symid.joint_models.friction_law import compute_columns
from tests.builds import run
from tests.friction_forms import EVERY_LAW, build_carrier

STRICT = "-std=c99 -O2 -fPIC -shared -Wall -Wextra -Wpedantic -Wconversion -Wshadow -Wdouble-promotion"
STRICT += " -Wmissing-prototypes -Werror"
LAWS = (
    *map(get_law, EVERY_LAW),
    get_law("stribeck-2.09"),
    get_law("stribeck", smoothing=0.02),
    get_law("asymmetric", smoothing=0.003),
)
EXACT = build_carrier(mpmath, mpmath.mpf, absolute=abs, maximum=max, minimum=min)
EACH_LAW = pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{law.name}-{law.smoothing:g}")


def build(folder, compiler, **options):
    """Return the compiled laws, and the texts that they are made of."""
    files = generate_friction_laws(LAWS, **options)
    for path, text in files:
        (folder / path).write_text(text, encoding="utf-8")
    run(folder, compiler, *STRICT.split(), files[1][0], "-o", "laws.so", "-lm")
    return ctypes.CDLL(str(folder / "laws.so")), [text for _, text in files]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory, c_compiler):
    return build(tmp_path_factory.mktemp("laws"), c_compiler)[0]


def draw(law, rng, count):
    """Return inputs (count,) and physical values, speeds over all scales of the law, rest and edges too."""
    special = {"vs": (0.005, 0.1), "gamma": (0.5, 4.0), "dq0": (0.002, 0.03), "dqs": (0.0, 0.03)}
    special |= {"delta": (0.2, 2.0), "g2": (50, 200), "g3": (5, 50), "g5": (50, 200), "fL": (0, 0.1)}
    special |= {"fLS": (0, 0.1), "TV": (10, 40)}
    values = [rng.uniform(*special.get(p.name, (0.5, 40.0))) for p in law.physical]
    speeds = rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(-5, 0.5, count)
    named = {p.name: value for p, value in zip(law.physical, values, strict=True)}
    speeds[:2] = (0.0, named.get("dq0", 0.1))
    # Of a motor's angle only some turns: an angle's own rounding grows with the turns.
    turn = 0.04 if "x100" in law.name else 4.0
    inputs = {"velocity": speeds, "load": rng.uniform(-50, 50, count)}
    inputs |= {"position": rng.uniform(-turn, turn, count), "temperature": rng.uniform(0, 80, count)}
    return {name: inputs[name] for name in law.inputs}, values


def call(library, law, inputs, values):
    function = getattr(library, f"symid_friction_{build_law_program(law).spec.name}")
    function.restype = ctypes.c_double
    parameters = (ctypes.c_double * len(values))(*values)
    arrays = [inputs[name] for name in law.inputs]
    return np.array([function(*map(ctypes.c_double, row), parameters) for row in zip(*arrays, strict=True)])


@EACH_LAW
def test_c_equals_numpy_and_forty_digits(compiled, law):
    rng = np.random.default_rng(7)
    for _ in range(20):
        inputs, values = draw(law, rng, 50)
        linear, shape = law.from_physical(values)
        terms = compute_columns(law, inputs, shape) * np.array(linear)
        largest = np.maximum(np.abs(terms).max(axis=1), 1e-300)
        if law.name.startswith("makkar"):
            # Its first term is a difference of two hyperbolic tangents.
            largest = np.maximum(largest, linear[0] * np.abs(np.tanh(shape[0] * inputs["velocity"])))
        found = call(compiled, law, inputs, values)
        assert np.max(np.abs(found - terms.sum(axis=1)) / largest) < 1e-14
        with mpmath.workdps(40):
            for k in range(0, 50, 7):
                point = {name: mpmath.mpf(float(array[k])) for name, array in inputs.items()}
                mixed = [
                    sum(a * mpmath.mpf(b) for a, b in zip(row, values, strict=True)) for row in law.unmixing
                ]
                count = len(linear)
                columns = law.columns(EXACT, point, mixed[count:])
                exact = sum(c * column for c, column in zip(mixed, columns, strict=False))
                assert abs(found[k] - float(exact)) / largest[k] < 1e-14


@EACH_LAW
def test_what_is_not_finite_gives_no_finite_torque_or_the_limit(compiled, law):
    """As the header says: a NaN for a NaN; for an infinite velocity a NaN, or what large ones tend to."""
    _, values = draw(law, np.random.default_rng(3), 2)
    inputs = {name: np.array([np.nan, np.inf, -np.inf]) for name in law.inputs[:1]}
    inputs |= {name: np.ones(3) for name in law.inputs[1:]}
    nan, *ends = call(compiled, law, inputs, values)
    assert np.isnan(nan)
    inputs = {name: entries[:2] for name, entries in inputs.items()} | {"velocity": np.array([1e30, -1e30])}
    large = call(compiled, law, inputs, values)
    for end, near in zip(ends, large, strict=True):
        assert np.isnan(end) or end == near or (np.isinf(end) and end * near > 0)


def test_single_precision_has_no_double_in_it(tmp_path, c_compiler):
    library, texts = build(tmp_path, c_compiler, prefix="arm", precision="float")
    assert not any("double" in text for text in texts)
    function = library.arm_friction_stribeck
    function.restype = ctypes.c_float
    torque = function(ctypes.c_float(0.02), (ctypes.c_float * 4)(11.0, 23.0, 0.03, 28.0))
    assert torque == pytest.approx(11 + 12 * np.exp(-4 / 9) + 0.56, rel=1e-6)
