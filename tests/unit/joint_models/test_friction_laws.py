"""Static friction laws against closed forms written anew, their derivatives, names and texts."""

import casadi
import mpmath
import numpy as np
import pytest
import sympy

from symid.errors import UsageError
from symid.joint_models.carriers import (
    build_casadi_carrier,
    build_float_carrier,
    build_numpy_carrier,
    build_symbol_carrier,
)
from symid.joint_models.friction_catalogue import (
    FRICTION_LAWS,
    build_improved,
    build_load_dependent,
    build_position_dependent,
    build_stribeck,
    fix_exponent,
    free_exponent,
    get_friction_law,
    get_law,
    has_sign,
    list_shape_names,
    list_value_names,
    name_shape,
    name_values,
    rename_law,
    with_offset,
)
from symid.joint_models.friction_law import (
    FrictionValues,
    compute_column_derivatives,
    compute_columns,
    compute_friction_torque,
    compute_stribeck_derivatives,
)
from symid.lessons.friction_formulas import write_friction
from tests.friction_forms import EVERY_LAW, FORMS, OLD_NAMES, VELOCITIES, build_carrier, find_torque, prepare
from tests.refusals import raises

EVERY = pytest.mark.parametrize("law", list(map(get_law, EVERY_LAW)), ids=EVERY_LAW)


MPMATH = build_carrier(mpmath, mpmath.mpf, absolute=abs, maximum=max, minimum=min)
SYMPY = build_carrier(sympy, sympy.Integer, absolute=sympy.Abs, maximum=sympy.Max, minimum=sympy.Min)
CASADI = build_carrier(
    casadi, casadi.SX, absolute=casadi.fabs, maximum=casadi.fmax, minimum=casadi.fmin, power=casadi.power
)


@EVERY
def test_many_samples_have_the_columns_of_few(law):
    """NumPy writes results into large arrays that only a tuple holds, if an operator gets them from there."""
    inputs, values = prepare(law)
    _, shape = law.from_physical(values)
    times = 1 + 40_000 // len(inputs["velocity"])
    many = {name: np.tile(column, times) for name, column in inputs.items()}
    for compute in (compute_columns, compute_column_derivatives):
        few = compute(law, inputs, shape)
        expected = np.tile(few, (times, *[1] * (few.ndim - 1)))
        assert np.allclose(compute(law, many, shape), expected, rtol=1e-12, atol=1e-12)


@EVERY
def test_torque_is_the_closed_form(law):
    inputs, values = prepare(law)
    named = {p.name: value for p, value in zip(law.physical, values, strict=True)}
    linear, shape = law.from_physical(values)
    samples = [dict(zip(inputs, map(float, row), strict=True)) for row in zip(*inputs.values(), strict=True)]
    expected = [find_torque(law.name, named, row.pop("velocity"), **row) for row in samples]
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


def test_at_rest_all_rates_are_finite_and_every_law_has_a_form():
    for law in map(get_law, EVERY_LAW):
        inputs, values = prepare(law, np.array([0.0, 0.0]))
        assert np.isfinite(compute_column_derivatives(law, inputs, law.from_physical(values)[1])).all()
    assert set(FORMS) == set(FRICTION_LAWS)
    law = get_law("stribeck-10")
    speeds = np.concatenate([[0.0], np.logspace(-12, 6, 200)])
    assert np.all(np.isfinite(compute_columns(law, {"velocity": speeds}, [1e-3])))
    assert np.all(np.isfinite(compute_column_derivatives(law, {"velocity": speeds}, [1e-3])))


@EVERY
def test_values_go_there_and_back_and_are_named_in_their_order(law):
    _, values = prepare(law)
    linear, shape = law.from_physical(values)
    assert len(linear) == len(law.linear)
    assert len(shape) == len(law.shape) <= 3
    np.testing.assert_allclose(law.to_physical(linear, shape), values, rtol=1e-15)
    identity = np.array(law.mixing) @ np.array(law.unmixing)
    np.testing.assert_array_equal(identity, np.eye(len(values)))
    assert law.from_physical(law.to_physical(linear, shape)) == (linear, shape)
    friction = FrictionValues(law=law.name, values=linear, shape=shape, smoothing=0.01)
    names = tuple(entry.name for entry in law.linear)
    assert list_value_names(friction) == list_value_names(FrictionValues(law=law.name)) == names
    assert list_shape_names(friction) == tuple(entry.name for entry in law.shape)
    assert name_values(friction) == dict(zip(names, linear, strict=True))
    assert name_shape(friction) == {entry.name: x for entry, x in zip(law.shape, shape, strict=True)}
    assert name_values(FrictionValues(law=law.name)) == name_shape(FrictionValues(law=law.name)) == {}
    assert get_friction_law(friction).smoothing == 0.01


@EVERY
def test_every_law_says_what_it_is_and_pushes_nothing(law):
    assert all((law.formula, law.source, law.smoothness, law.passivity))
    assert len({p.name for p in (*law.linear, *law.shape)}) == len(law.linear) + len(law.shape)
    for parameter in (*law.linear, *law.shape, *law.physical):
        assert parameter.unit
        assert parameter.unit_prismatic
        assert parameter.meaning
        assert parameter.lower < parameter.upper
    assert all(parameter.lower >= 0.0 for parameter in law.shape)
    latex = write_friction(law)
    assert all(latex.count(a) == latex.count(b) for a, b in ((r"\left", r"\right"), ("{", "}")))
    assert all(parameter.latex in latex for parameter in law.physical)
    assert get_law(law.name) is law
    inputs, values = prepare(law)
    names = [p.name for p in law.physical]
    quiet = [
        0.0 if n in {"offset", "fP", "dqs"} or n[0] in "AB" else v for n, v in zip(names, values, strict=True)
    ]
    linear, shape = law.from_physical(quiet)
    power = inputs["velocity"] * compute_friction_torque(law, inputs, linear, shape)
    assert np.all(power >= 0.0)
    linear, shape = law.from_physical(values)
    laws = law, get_law(law.name, smoothing=0.01)
    sharp, smooth = (compute_friction_torque(entry, inputs, linear, shape) for entry in laws)
    assert has_sign(law) == (not np.array_equal(sharp, smooth))


def test_the_improved_law_meets_the_published_points():
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


def test_smoothing_and_offsets_change_a_law():
    law = get_law("coulomb-viscous", smoothing=0.02)
    torque = compute_friction_torque(law, {"velocity": VELOCITIES}, [28.0, 11.0], ())
    np.testing.assert_allclose(torque, 28 * VELOCITIES + 11 * np.tanh(VELOCITIES / 0.02), rtol=1e-14)
    assert law.smoothing == 0.02
    assert "tanh" in write_friction(law)
    law = with_offset(get_law("stribeck-exponent"))
    assert [p.name for p in law.linear] == ["Fv", "Fc", "Fe", "offset"]
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
        ("lugr", "did you mean lugre"),
    ],
)
def test_a_law_that_does_not_exist_is_refused(name, hint):
    with raises(UsageError, "usage.unknown-friction-law", match=hint) as caught:
        get_law(name)
    assert repr(name.lower()) in str(caught.value).lower()
    assert all(known in str(caught.value) for known in FRICTION_LAWS)


def test_some_laws_as_formulas_and_in_latex():
    fall = "[fC + (fS - fC) exp(-|dq / vs|{})] sign(dq) + fV dq"
    assert [get_law(name).formula for name in ("tustin", "stribeck")] == [fall.format(""), fall.format("^2")]
    assert get_law("cubic").formula == "fC sign(dq) + fV dq + fV2 |dq| dq + fV3 |dq|^2 dq"
    assert write_friction(get_law("coulomb-viscous")) == (
        r"f_V \, \dot q + f_C \, \operatorname{sgn}\left(\dot q\right)"
    )
    assert write_friction(get_law("stribeck-exponent")) == (
        r"f_V \, \dot q + f_C \, \operatorname{sgn}\left(\dot q\right) + \left(f_S - f_C\right) \, "
        r"e^{-\left|\frac{\dot q}{v_s}\right|^{\gamma}} \, \operatorname{sgn}\left(\dot q\right)"
    )
    assert r"\left(\dot q - \dot q_0\right)" in write_friction(get_law("improved-stribeck-h4"))
    assert write_friction(get_law("temperature-viscous")).endswith(
        r" + f_{VL} \, e^{-\frac{T}{T_V}} \, \dot q"
    )


@pytest.mark.parametrize(
    ("name", "law"),
    [
        *((name, law) for name, law in OLD_NAMES.items() if name != law),
        ("Stribeck_Offset", "stribeck+offset"),
        ("viscous-coulomb", "coulomb-viscous"),
        ("coulomb-viscous+offset", "coulomb-viscous-offset"),
        ("stribeck-1", "tustin"),
        ("stribeck-1+offset", "tustin+offset"),
        ("stribeck-2", "stribeck"),
        ("stribeck-1.60", "stribeck-1.6"),
        ("improved-stribeck-h1-exponent", "improved-stribeck-exponent"),
        ("polynomial-2,3", "cubic"),
        ("position-torque-1,2", "position-torque"),
        ("position-dependent-1,2x1", "position-dependent"),
    ],
)
def test_a_law_has_one_name_however_it_is_asked_for(name, law):
    assert get_law(name).name == rename_law(name) == law


@pytest.mark.parametrize(
    ("name", "free", "tustin"),
    [
        ("stribeck", "stribeck-exponent", "tustin"),
        ("stribeck+offset", "stribeck-exponent+offset", "tustin+offset"),
        ("stribeck+cubic", "stribeck-exponent+cubic", "stribeck-1+cubic"),
        ("improved-stribeck-h4", "improved-stribeck-h4-exponent", "improved-stribeck-h4-1"),
        ("asymmetric-stribeck-both", "asymmetric-stribeck-both-exponent", "asymmetric-stribeck-both-1"),
        ("load-dependent-stribeck", "load-dependent-stribeck-exponent", "load-dependent-stribeck-1"),
    ],
)
def test_an_exponent_of_one_or_two_is_part_of_the_name(name, free, tustin):
    searched = free_exponent(get_law(name))
    assert searched.name == free
    assert searched.shape[-1].name == "gamma"
    assert fix_exponent(searched, 1.6) == free
    assert fix_exponent(searched, 2.0) == name
    assert fix_exponent(searched, 1.0) == tustin
    assert fix_exponent(get_law(name), 1.6) == name
    # Others have none to search.
    assert free_exponent(get_law(free)) is free_exponent(get_law("lorentzian")) is None


def test_no_friction_has_no_law_and_a_name_without_one_cannot_be_renamed():
    none = FrictionValues()
    assert get_friction_law(none) is None
    assert rename_law("none") == "none"
    named = list_value_names(none), list_shape_names(none), name_values(none), name_shape(none)
    assert named == ((), (), {}, {})
    with pytest.raises(UsageError, match=r"'viscus'.* Known laws: "):
        rename_law("viscus")


SYMBOLS = build_symbol_carrier()
SPEEDS = np.array([-2.0, -0.3, -0.05, 0.0, 0.02, 0.1, 0.7])


@pytest.mark.parametrize("smoothing", [0.0, 0.05])
def test_rates_are_the_derivatives_by_the_stribeck_velocity(smoothing):
    v, speed = sympy.symbols("v v_s", positive=True)
    shape, *rates = compute_stribeck_derivatives(SYMBOLS, v, speed, smoothing)
    sign = sympy.tanh(v / smoothing) if smoothing else 1
    for order, rate in enumerate((shape, *rates)):
        difference = sympy.diff(sympy.exp(-((v / speed) ** 2)) * sign, speed, order) - rate
        for value, at in ((0.1, 0.2), (0.5, 0.3), (1.3, 2.0)):
            assert abs(float(difference.subs({v: value, speed: at}))) < 1e-12
    arrays = compute_stribeck_derivatives(build_numpy_carrier(), SPEEDS, 0.15, smoothing)
    u = casadi.SX.sym("u")
    graph = compute_stribeck_derivatives(build_casadi_carrier(), u, 0.15, smoothing)
    function = casadi.Function("f", [u], [casadi.horzcat(*graph)])
    found = np.array([function(value).full().ravel() for value in SPEEDS]).T
    np.testing.assert_allclose(arrays, found, rtol=1e-12, atol=1e-300)
