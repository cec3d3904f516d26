"""Friction with a memory: one definition over all carriers, its step, its equations, what it refuses."""

from dataclasses import replace

import casadi
import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, strategies as st

from symid.errors import UsageError
from symid.joint_models import (
    advance_memory,
    build_float_carrier,
    build_numpy_carrier,
    convert_printed,
    get_law,
    is_passive,
    list_state_parameters,
)
from tests.friction_forms import build_carrier
from tests.refusals import raises
from tests.state_laws import (
    LAWS,
    build_values,
    count_deflections,
    find_level,
    find_rate,
    find_torque,
    give_values,
    move_bristles,
    print_values,
    take_step,
)

FLOATS = build_float_carrier()
SYMBOLS = build_carrier(sympy, sympy.Integer, absolute=sympy.Abs, maximum=sympy.Max, minimum=sympy.Min)
BRISTLES = ("dahl", "lugre", "lugre+offset")


def build(name, **changed):
    return build_values(name, print_values(name) | changed)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("velocity", [-0.5, -0.003, 0.0, 0.01, 2.0])
def test_all_carriers_agree_with_the_equations(name, velocity):
    values, period = build(name), 1e-3
    states = [2e-4 * (-1.0) ** k for k in range(count_deflections(name))]
    torque, after = take_step(give_values(name), velocity, period, states)
    functions = {"maximum": max, "minimum": min}
    graphs = {"absolute": casadi.fabs, "maximum": casadi.fmax, "minimum": casadi.fmin}
    for carrier, lift in (
        (FLOATS, float),
        (build_numpy_carrier(), lambda value: np.full(3, value)),
        (build_carrier(mpmath, mpmath.mpf, absolute=mpmath.fabs, **functions), mpmath.mpf),
        (build_carrier(casadi, casadi.SX, **graphs), casadi.SX),
        (SYMBOLS, sympy.Float),
    ):
        lifted = {key: lift(value) for key, value in values.items()}
        way, bent = lift(velocity * period), list(map(lift, states))
        force, moved = advance_memory(carrier, lifted, lift(velocity), way, bent)
        for found, wanted in zip((force, *moved), (torque, *after), strict=True):
            numbers = found if isinstance(found, np.ndarray) else float(found)
            np.testing.assert_allclose(numbers, wanted, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("name", BRISTLES)
def test_symbols_give_the_numbers_and_the_step_solves_the_rate(name):
    p, law = give_values(name), get_law(name)
    v, z = sympy.symbols("v z", real=True)
    h, *parameters = sympy.symbols(["h", *(one.name for one in list_state_parameters(law))], positive=True)
    # The least level is for computing alone.
    algebra = replace(SYMBOLS, maximum=lambda level, _least: level)
    values = convert_printed(algebra, law, {symbol.name: symbol for symbol in parameters})
    torque, _ = advance_memory(algebra, values, v, sympy.Integer(0), (z,))
    _, (after,) = advance_memory(algebra, values, v, v * h, (z,))
    places = {symbol: print_values(name)[symbol.name] for symbol in parameters}
    at = {**places, v: -0.013, z: 3e-4, h: 2e-3}
    assert float(torque.subs(at)) == pytest.approx(find_torque(p, -0.013, [3e-4]), rel=1e-12)
    assert float(after.subs(at)) == pytest.approx(take_step(p, -0.013, 2e-3, [3e-4])[1][0], rel=1e-12)
    # Derivative of the step by its period, in symbols: nothing else was used to derive it.
    slope = sympy.diff(after, h)
    for speed, bend in ((0.3, 1e-4), (-0.02, 5e-4), (0.001, -2e-4)):
        at = {**places, v: speed, z: bend, h: 0.004}
        rate = find_rate(p, speed, float(after.subs(at)))
        assert float(slope.subs(at)) == pytest.approx(rate, abs=1e-13 * abs(speed))
    assert after.subs(h, 0).equals(z)


steps = st.tuples(
    st.floats(-3.0, 3.0).filter(lambda v: v == 0 or abs(v) > 1e-9), st.floats(0.0, 10.0), st.floats(-1.0, 1.0)
)


@pytest.mark.parametrize("name", LAWS)
@given(step=steps, share=st.floats(0.0, 1.0))
def test_a_step_is_its_parts_is_odd_and_stays_bounded(name, step, share):
    values, p, (velocity, period, part) = build(name), give_values(name), step
    # Elements move_bristles their level at once.
    level = find_level(p, velocity if "share" in p else 0.0)
    bounds = np.atleast_1d(np.multiply(p.get("share", 1.0), level) / (p.get("sigma0") or p["stiffness"]))

    def move(speed, time, states):
        return np.array(advance_memory(FLOATS, values, speed, speed * time, states)[1])

    states = part * bounds
    whole = move(velocity, period, states)
    both = move(velocity, (1.0 - share) * period, move(velocity, share * period, states))
    assert np.all(np.abs(whole - both) <= 1e-13 * bounds)
    assert np.array_equal(move(-velocity, period, -states), -whole)
    assert np.all(np.abs(whole) <= bounds * (1.0 + 1e-15))


@pytest.mark.parametrize("name", LAWS)
def test_a_run_is_its_steps_and_ends_at_the_static_law(name):
    p, states = give_values(name), [1e-4] * count_deflections(name)
    velocity = np.append(0.1 * np.sin(np.linspace(0.0, 30.0, 200)), [0.0, -0.02])
    period = np.append(np.full(201, 1e-3), 1e6)
    torque, deflections = move_bristles(build(name), velocity, velocity * period, states)
    for k, (v, h) in enumerate(zip(velocity.tolist(), period.tolist(), strict=True)):
        wanted, states = take_step(p, v, h, states)
        assert torque[k] == pytest.approx(wanted, rel=1e-11, abs=1e-11)
        np.testing.assert_allclose(deflections[k], states, rtol=1e-12, atol=1e-17)
    np.testing.assert_array_equal(deflections[-2], deflections[-3])
    assert torque[-1] == pytest.approx(-find_level(p, -0.02) - 0.02 * p["Fv"] + p.get("offset", 0.0))
    straight, _ = advance_memory(FLOATS, build(name), 0.0, 0.0, [0.0] * count_deflections(name))
    assert straight == p.get("offset", 0.0)


@pytest.mark.parametrize(("static", "viscous"), [(15.0, 40.0), (10.0, 0.0), (5.0, 80.0)])
def test_passivity_is_known_where_viscous_friction_covers_the_fall(static, viscous):
    """A static level below Coulomb friction counts as much: (max - min) / min = 1."""
    level = {"fC": 10.0, "sigma1": 80.0, "fS": static}
    assert is_passive(build("lugre", **level, fV=viscous))
    if viscous:
        assert is_passive(build("lugre", **level, fV=viscous - 0.1)) is None
    assert is_passive(build("dahl", fV=0.0))


def test_laws_without_bristles_are_refused():
    with raises(UsageError, "joint.no-bristles", match="'coulomb' .*: dahl, lugre"):
        list_state_parameters(get_law("coulomb"))
