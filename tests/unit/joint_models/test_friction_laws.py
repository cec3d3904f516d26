"""Static friction laws against closed forms written anew, their derivatives, names and texts."""

import math

import casadi
import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, strategies as st

from symid.errors import UsageError
from symid.joint_models.carriers import OperatorCarrier, build_float_carrier, build_numpy_carrier
from symid.joint_models.friction_catalogue import (
    FRICTION_LAWS,
    build_improved,
    build_load_dependent,
    build_position_dependent,
    build_stribeck,
    get_law,
    with_offset,
    with_smoothing,
)
from symid.joint_models.friction_law import (
    compute_column_derivatives,
    compute_columns,
    compute_friction_torque,
)

VELOCITIES = np.array([-2.0, -0.3, -0.05, -0.011, -0.004, 0.0, 1e-6, 0.002, 0.01, 0.0301, 0.2, 1.7])
EVERY = pytest.mark.parametrize("law", FRICTION_LAWS.values(), ids=FRICTION_LAWS)


def _mpmath_sign(x):
    return mpmath.mpf(int(x > 0) - int(x < 0))


MPMATH = OperatorCarrier(
    zero=mpmath.mpf(0),
    one=mpmath.mpf(1),
    exp=mpmath.exp,
    tanh=mpmath.tanh,
    sin=mpmath.sin,
    cos=mpmath.cos,
    sign=_mpmath_sign,
    absolute=abs,
    maximum=max,
    minimum=min,
)
SYMPY = OperatorCarrier(
    zero=sympy.Integer(0),
    one=sympy.Integer(1),
    exp=sympy.exp,
    tanh=sympy.tanh,
    sin=sympy.sin,
    cos=sympy.cos,
    sign=sympy.sign,
    absolute=sympy.Abs,
    maximum=sympy.Max,
    minimum=sympy.Min,
)
CASADI = OperatorCarrier(
    zero=casadi.SX(0),
    one=casadi.SX(1),
    exp=casadi.exp,
    tanh=casadi.tanh,
    sin=casadi.sin,
    cos=casadi.cos,
    sign=casadi.sign,
    absolute=casadi.fabs,
    maximum=casadi.fmax,
    minimum=casadi.fmin,
    power=casadi.power,
)


def prepare(law, velocities=VELOCITIES):
    """Return inputs and physical values that suit a law; every value is another one."""
    count = len(velocities)
    inputs = {
        "velocity": np.asarray(velocities, dtype=float),
        "load": np.linspace(-20, 31, count),
        "position": np.linspace(-3, 5, count),
    }
    special = {"fC": 11.0, "fS": 23.0, "vs": 0.028, "gamma": 1.7, "fV": 28.0, "dq0": 0.01, "dqs": 0.02}
    special |= {"fP": -3.3, "g2": 90.0, "g3": 12.0, "g5": 130.0, "delta": 0.6, "fL": 0.03, "fLS": 0.05}
    values = [special.get(p.name, 1.0 + 0.37 * k) for k, p in enumerate(law.physical)]
    return {name: inputs[name] for name in law.inputs}, values


def curve(p, speed, gamma=2.0):
    """Return Stribeck's curve at speed >= 0."""
    return p["fC"] + (p["fS"] - p["fC"]) * math.exp(-((speed / p["vs"]) ** gamma)) + p["fV"] * speed


def fall(p, v):
    return math.exp(-((v / p["vs"]) ** 2))


def improved(p, v):
    """Reading H1, by case."""
    gamma, edge = p.get("gamma", 2.0), p["dq0"]
    if abs(v) >= edge:
        return p["fP"] + curve(p, abs(v), gamma) * np.sign(v)
    return p["fP"] + curve(p, edge, gamma) * v / edge


def improved_h2(p, v):
    edge = p["dq0"]
    if abs(v) >= edge:
        return curve(p, abs(v)) * np.sign(v)
    return p["fP"] + (np.sign(v) * curve(p, edge) - p["fP"]) * abs(v) / edge


def side(p, v, name):
    return p[name + ("p" if v > 0 else "n")]


def loaded(p, v, load):
    kinetic, static = p["fC"] + p["fL"] * abs(load), p["fS"] + p["fLS"] * abs(load)
    return (kinetic + (static - kinetic) * fall(p, v) + p["fV"] * abs(v)) * np.sign(v)


def waves(p, angle):
    return sum(p[f"A{k}"] * math.cos(k * angle) + p[f"B{k}"] * math.sin(k * angle) for k in (1, 2))


def makkar(p, v):
    bump = p["fM"] * (math.tanh(p["g2"] * v) - math.tanh(p["g3"] * v))
    return bump + p["fC"] * math.tanh(p["g5"] * v) + p["fV"] * v


def polynomial(p, v):
    return p["fV2"] * v**2 * np.sign(v) + p["fV3"] * v**3


def asymmetric(p, v, bump=0.0):
    return (side(p, v, "fC") + bump + side(p, v, "fV") * abs(v)) * np.sign(v)


# The torque of each law from its physical parameters p, at v, load l and position x.
FORMS = {
    "coulomb": lambda p, v, _l, _x: p["fC"] * np.sign(v),
    "coulomb-viscous": lambda p, v, _l, _x: p["fC"] * np.sign(v) + p["fV"] * v,
    "coulomb-viscous-offset": lambda p, v, _l, _x: p["fC"] * np.sign(v) + p["fV"] * v + p["offset"],
    "asymmetric": lambda p, v, _l, _x: asymmetric(p, v),
    "tustin": lambda p, v, _l, _x: curve(p, abs(v), 1.0) * np.sign(v),
    "stribeck": lambda p, v, _l, _x: curve(p, abs(v)) * np.sign(v),
    "stribeck-exponent": lambda p, v, _l, _x: curve(p, abs(v), p["gamma"]) * np.sign(v),
    "stribeck+cubic": lambda p, v, _l, _x: curve(p, abs(v)) * np.sign(v) + polynomial(p, v),
    "lorentzian": lambda p, v, _l, _x: (
        (p["fC"] + (p["fS"] - p["fC"]) / (1 + (v / p["vs"]) ** 2)) * np.sign(v) + p["fV"] * v
    ),
    "improved-stribeck": lambda p, v, _l, _x: improved(p, v),
    "improved-stribeck-exponent": lambda p, v, _l, _x: improved(p, v),
    "improved-stribeck-h2": lambda p, v, _l, _x: improved_h2(p, v),
    "improved-stribeck-h3": lambda p, v, _l, _x: p["fP"] + curve(p, abs(v)) * np.sign(v),
    "improved-stribeck-h4": lambda p, v, _l, _x: (
        p["fP"] + curve(p, abs(v - p["dqs"])) * np.sign(v - p["dqs"])
    ),
    "asymmetric-stribeck": lambda p, v, _l, _x: asymmetric(p, v, p["fE"] * fall(p, v)),
    "asymmetric-stribeck-both": lambda p, v, _l, _x: asymmetric(
        p, v, (side(p, v, "fS") - side(p, v, "fC")) * fall(p, v)
    ),
    "cubic": lambda p, v, _l, _x: p["fC"] * np.sign(v) + p["fV"] * v + polynomial(p, v),
    "power-law": lambda p, v, _l, _x: (p["fC"] + p["fD"] * abs(v) ** p["delta"]) * np.sign(v),
    "makkar": lambda p, v, _l, _x: makkar(p, v),
    "load-dependent": lambda p, v, load, _x: (p["fC"] + p["fL"] * abs(load)) * np.sign(v) + p["fV"] * v,
    "load-dependent-stribeck": lambda p, v, load, _x: loaded(p, v, load),
    "position-dependent": lambda p, v, _l, x: (p["fC"] + waves(p, x)) * np.sign(v) + p["fV"] * v,
    "position-torque": lambda p, v, _l, x: p["fC"] * np.sign(v) + p["fV"] * v + waves(p, x),
}


def written_anew(name, p, v, load, position):
    """Return the torque of a law for one sample, by its own formula."""
    return FORMS[name](p, v, load, position)


@EVERY
def test_torque_is_the_closed_form(law):
    inputs, values = prepare(law)
    named = {p.name: value for p, value in zip(law.physical, values, strict=True)}
    linear, shape = law.from_physical(values)
    nothing = np.zeros(len(VELOCITIES))
    expected = [
        written_anew(law.name, named, float(v), float(load), float(position))
        for v, load, position in zip(
            inputs["velocity"], inputs.get("load", nothing), inputs.get("position", nothing), strict=True
        )
    ]
    np.testing.assert_allclose(
        compute_friction_torque(law, inputs, linear, shape), expected, rtol=1e-13, atol=1e-13
    )


@EVERY
def test_all_carriers_agree(law):
    inputs, values = prepare(law)
    _, shape = law.from_physical(values)
    columns = compute_columns(law, inputs, shape)
    assert columns.shape == (len(VELOCITIES), len(law.linear))
    symbols = {name: sympy.Symbol(name, real=True) for name in law.inputs}
    graphs = {name: casadi.SX.sym(name) for name in law.inputs}
    expressions = law.columns(SYMPY, symbols, [sympy.Float(value, 40) for value in shape])
    found = law.columns(CASADI, graphs, [casadi.SX(value) for value in shape])
    function = casadi.Function("f", list(graphs.values()), [casadi.vertcat(*found)])
    for k in range(len(VELOCITIES)):
        point = {name: float(array[k]) for name, array in inputs.items()}
        single = law.columns(build_float_carrier(), point, shape)
        np.testing.assert_allclose(columns[k], single, rtol=1e-14, atol=3e-16)
        exact = law.columns(
            MPMATH,
            {name: mpmath.mpf(value) for name, value in point.items()},
            [mpmath.mpf(value) for value in shape],
        )
        # Only floats enter a power or product of decimals more than once: rounding grows with the exponent.
        np.testing.assert_allclose(columns[k], [float(entry) for entry in exact], rtol=2e-13, atol=3e-16)
        np.testing.assert_allclose(
            columns[k], function(*point.values()).full().ravel(), rtol=2e-13, atol=3e-16
        )
        if k % 3 == 0:
            values_at = {symbols[name]: sympy.Float(value, 40) for name, value in point.items()}
            symbolic = [float(sympy.sympify(entry).subs(values_at)) for entry in expressions]
            np.testing.assert_allclose(columns[k], symbolic, rtol=2e-13, atol=3e-16)


@EVERY
def test_rates_are_the_derivatives_by_the_shape(law):
    """Central differences in 40 digits; the velocities stand off the knees."""
    inputs, values = prepare(law, np.array([-1.3, -0.0321, -0.0072, 0.003, 0.0123, 0.21]))
    _, shape = law.from_physical(values)
    rates = compute_column_derivatives(law, inputs, shape)
    assert rates.shape == (6, len(law.linear), len(law.shape))
    with mpmath.workdps(40):
        step = mpmath.mpf(10) ** -15
        for k in range(6):
            point = {name: mpmath.mpf(float(array[k])) for name, array in inputs.items()}
            for j in range(len(shape)):
                sides = []
                for side in (1, -1):
                    moved = [
                        mpmath.mpf(value) + (side * step if i == j else 0) for i, value in enumerate(shape)
                    ]
                    sides.append(law.columns(MPMATH, point, moved))
                expected = [float((a - b) / (2 * step)) for a, b in zip(*sides, strict=True)]
                np.testing.assert_allclose(rates[k, :, j], expected, rtol=1e-11, atol=1e-11)


def test_at_rest_all_rates_are_finite():
    for law in FRICTION_LAWS.values():
        inputs, values = prepare(law, np.array([0.0, 0.0]))
        assert np.isfinite(compute_column_derivatives(law, inputs, law.from_physical(values)[1])).all()


@EVERY
def test_physical_values_go_there_and_back(law):
    _, values = prepare(law)
    linear, shape = law.from_physical(values)
    assert len(linear) == len(law.linear)
    assert len(shape) == len(law.shape) <= 3
    np.testing.assert_allclose(law.to_physical(linear, shape), values, rtol=1e-15)
    identity = np.array(law.mixing) @ np.array(law.unmixing)
    np.testing.assert_array_equal(identity, np.eye(len(values)))
    assert law.from_physical(law.to_physical(linear, shape)) == (linear, shape)


def test_every_law_has_a_form_of_its_own_here():
    assert set(FORMS) == set(FRICTION_LAWS)


@EVERY
def test_every_law_says_what_it_is(law):
    assert all((law.formula, law.source, law.smoothness, law.passivity))
    assert len({p.name for p in (*law.linear, *law.shape)}) == len(law.linear) + len(law.shape)
    for parameter in (*law.linear, *law.shape, *law.physical):
        assert parameter.unit
        assert parameter.unit_prismatic
        assert parameter.meaning
        assert parameter.lower < parameter.upper
        if parameter.start is not None:
            assert parameter.lower <= parameter.start <= parameter.upper
    for parameter in law.shape:
        assert parameter.start is not None
        assert parameter.lower >= 0.0
    assert law.latex.startswith(r"\tau_f = ")
    assert law.latex.count(r"\left") == law.latex.count(r"\right")
    assert law.latex.count("{") == law.latex.count("}")
    assert all(parameter.latex in law.latex for parameter in law.physical)
    assert get_law(law.name) is law


@EVERY
def test_no_law_pushes_with_the_values_it_is_meant_for(law):
    inputs, values = prepare(law)
    names = [p.name for p in law.physical]
    quiet = [
        0.0 if n in {"offset", "fP", "dqs"} or n[0] in "AB" else v for n, v in zip(names, values, strict=True)
    ]
    linear, shape = law.from_physical(quiet)
    power = inputs["velocity"] * compute_friction_torque(law, inputs, linear, shape)
    assert np.all(power >= 0.0)


def test_the_improved_law_is_continuous_and_meets_the_published_points():
    """Derived points of the paper's Table 3: torque at the zone's edge and the least of the curve."""
    law = get_law("improved-stribeck")
    table = {
        (11.64, 23.19, 0.02767, 27.88, 0.0, 0.010): (22.05, 0.056, 13.39),
        (39.93, 73.24, 0.01292, 89.24, 0.0, 0.005): (69.05, 0.028, 42.73),
        (38.53, 53.78, 0.01557, 89.49, 0.0, 0.010): (49.52, 0.030, 41.59),
    }
    for values, (edge, place, least) in table.items():
        linear, shape = law.from_physical(values)
        at = np.array([values[5] * (1 - 1e-12), values[5], values[5] * (1 + 1e-12)])
        torque = compute_friction_torque(law, {"velocity": at}, linear, shape)
        np.testing.assert_allclose(torque, edge, atol=0.006)
        assert np.ptp(torque) < 1e-8
        speeds = np.linspace(values[5], 0.2, 20001)
        curve = compute_friction_torque(law, {"velocity": speeds}, linear, shape)
        assert curve.min() == pytest.approx(least, abs=0.006)
        assert speeds[curve.argmin()] == pytest.approx(place, abs=6e-4)


@given(st.floats(1e-3, 0.2), st.floats(-2, 2), st.floats(0.5, 4.0))
def test_the_columns_of_the_improved_law_hold_within_the_zone(edge, velocity, gamma):
    law = build_improved(exponent=None)
    values = [11.6, 23.2, 0.028, gamma, 27.9, 0.47, edge]
    linear, shape = law.from_physical(values)
    torque = compute_friction_torque(law, {"velocity": np.array([velocity])}, linear, shape)[0]
    named = {p.name: value for p, value in zip(law.physical, values, strict=True)}
    assert torque == pytest.approx(written_anew(law.name, named, velocity, 0, 0), rel=1e-12, abs=1e-12)


def test_columns_broadcast_over_many_shapes_at_once():
    law = get_law("improved-stribeck")
    speeds = np.array([0.01, 0.02, 0.05])
    edges = np.full(3, 0.005)
    found = law.columns(
        build_numpy_carrier(), {"velocity": VELOCITIES[None]}, [speeds[:, None], edges[:, None]]
    )
    for k, speed in enumerate(speeds):
        expected = compute_columns(law, {"velocity": VELOCITIES}, [speed, 0.005])
        np.testing.assert_array_equal(np.broadcast_to(found[2], (3, len(VELOCITIES)))[k], expected[:, 2])


def test_smoothing_replaces_the_sign_by_a_hyperbolic_tangent():
    law = get_law("coulomb-viscous", smoothing=0.02)
    torque = compute_friction_torque(law, {"velocity": VELOCITIES}, [28.0, 11.0], ())
    np.testing.assert_allclose(torque, 28 * VELOCITIES + 11 * np.tanh(VELOCITIES / 0.02), rtol=1e-14)
    assert law.smoothing == 0.02
    assert "tanh" in law.latex
    assert with_smoothing(law, 0.0) is law


def test_an_offset_is_the_last_linear_parameter():
    law = with_offset(get_law("stribeck-exponent"))
    assert [p.name for p in law.linear] == ["Fv", "Fc", "Fs", "offset"]
    assert [p.name for p in law.physical] == ["fC", "fS", "vs", "gamma", "fV", "offset"]
    values = (1.0, 2.0, 0.05, 1.5, 3.0, -0.7)
    linear, shape = law.from_physical(values)
    assert linear == (3.0, 1.0, 1.0, -0.7)
    assert shape == (0.05, 1.5)
    assert law.to_physical(linear, shape) == values
    assert compute_friction_torque(law, {"velocity": np.zeros(2)}, linear, shape).tolist() == [-0.7, -0.7]


@pytest.mark.parametrize(
    ("law", "name"),
    [
        (build_stribeck(exponent=2.09), "stribeck-2.09"),
        (build_stribeck(exponent=None, orders=(2, 3)), "stribeck-exponent+cubic"),
        (build_improved(reading="H2", exponent=None), "improved-stribeck-h2-exponent"),
        (build_improved(reading="H4", exponent=1.6), "improved-stribeck-h4-1.6"),
        (build_load_dependent(falls=True, exponent=1.3), "load-dependent-stribeck-1.3"),
        (build_position_dependent((1, 3), gear=100.5), "position-dependent-1,3x100.5"),
        (with_offset(build_stribeck(exponent=1.5)), "stribeck-1.5+offset"),
    ],
)
def test_a_name_says_all_of_a_law(law, name):
    assert law.name == name
    again = get_law(name)
    assert [p.name for p in again.physical] == [p.name for p in law.physical]
    inputs, values = prepare(law)
    pair = law.from_physical(values)
    np.testing.assert_array_equal(
        compute_friction_torque(again, inputs, *pair), compute_friction_torque(law, inputs, *pair)
    )


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("stribek", r"stribeck or .*\? "),
        ("coulomb+viscous", "coulomb-viscous "),
        ("stribeck-0", "exponent .* 10"),
        ("position-dependent-1,1", "orders .* differ"),
        ("stribeck+offset+offset", "offset already"),
        ("", r"''\. "),
        ("zzz", r"'zzz'\. "),
        ("stribeck-400", "exponent .* 10"),
        ("improved-stribeck-h2-150+offset", "exponent .* 10"),
        ("stribeck-1e400", "exponent .* 10"),
        ("position-dependent-1x1e999", "gear ratio .* finite"),
        ("polynomial-2,2", "orders .* differ"),
        ("LuGre", "get_dynamic_law"),
    ],
)
def test_a_law_that_does_not_exist_is_refused(name, hint):
    with pytest.raises(UsageError, match=hint) as caught:
        get_law(name)
    assert caught.value.notices[0].code == "usage.unknown-friction-law"
    assert repr(name.lower()) in str(caught.value).lower()
    assert all(known in str(caught.value) for known in FRICTION_LAWS)


def test_the_largest_exponent_of_robot_files_is_allowed_and_its_columns_are_finite():
    law = get_law("stribeck-10")
    speeds = np.concatenate([[0.0], np.logspace(-12, 6, 200)])
    assert np.all(np.isfinite(compute_columns(law, {"velocity": speeds}, [1e-3])))
    assert np.all(np.isfinite(compute_column_derivatives(law, {"velocity": speeds}, [1e-3])))


@pytest.mark.parametrize(
    ("name", "formula"),
    [
        ("tustin", "[fC + (fS - fC) exp(-|dq / vs|)] sign(dq) + fV dq"),
        ("cubic", "fC sign(dq) + fV dq + fV2 |dq| dq + fV3 |dq|^2 dq"),
        ("stribeck", "[fC + (fS - fC) exp(-|dq / vs|^2)] sign(dq) + fV dq"),
    ],
)
def test_formulas_leave_out_an_exponent_of_one(name, formula):
    assert get_law(name).formula == formula


def test_some_laws_in_latex():
    assert get_law("coulomb-viscous").latex == (
        r"\tau_f = f_V \, \dot q + f_C \, \operatorname{sgn}\left(\dot q\right)"
    )
    assert get_law("stribeck-exponent").latex == (
        r"\tau_f = f_V \, \dot q + f_C \, \operatorname{sgn}\left(\dot q\right) + \left(f_S - f_C\right) \, "
        r"e^{-\left|\frac{\dot q}{v_s}\right|^{\gamma}} \, \operatorname{sgn}\left(\dot q\right)"
    )
    assert r"\left(\dot q - \dot q_0\right)" in get_law("improved-stribeck-h4").latex
